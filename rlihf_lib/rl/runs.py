"""Runs: what determines one, its readable id and its hash, its folder, and whether it is done."""

import dataclasses
import json
import os
import shutil
from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import pandas as pd

from rlihf_lib.files import SUMS, cannot_write, canonical_json, check_sums, sha256, sums
from rlihf_lib.rl.asking import Asking
from rlihf_lib.rl.given import Given, given
from rlihf_lib.rl.observer import OBSERVERS
from rlihf_lib.rl.rewards import FEEDBACK, REWARDS
from rlihf_lib.rl.schedules import SCHEDULES
from rlihf_lib.rl.timing import Timing

CONDITIONS = ("sparse", "dense", "rlihf")
#: Functions that a run may be given, and what else is chosen by name.
FUNCTIONS: dict[str, dict[str, Callable]] = {
    "observer": OBSERVERS,
    "reward": REWARDS,
    "feedback": FEEDBACK,
}
NAMED: dict[str, Collection[str]] = {"condition": CONDITIONS, "schedule": SCHEDULES, **FUNCTIONS}
PARTS = ("sac", "timing", "asking")  # fields that have fields of their own
# Raised by whoever changes task, observer, rewards or learner, or a default below, so that results
# change: runs of an earlier protocol then count as missing.
PROTOCOL = 6
ACTOR = "actor.safetensors"  # of the first seed only where runs are shipped


@dataclass(frozen=True)
class SACSettings:
    """Hyper-parameters of every run, the same for all conditions."""

    hidden: tuple[int, ...] = (128, 128)
    """Units of the hidden layers of actor and critics."""
    learning_rate: float = 7e-4
    """Of Adam, for actor, critics and entropy coefficient."""
    batch_size: int = 256
    """Transitions per update."""
    discount: float = 0.9
    """Per control step of 0.1 s: a horizon of 1 s. Feedback comes at once; farther, what a better
    step earns drowns in the noise of all that follows."""
    tau: float = 0.01
    """Share of the critics that enters their targets per update."""
    learning_starts: int = 2_000
    """Steps of uniformly random actions before learning."""
    train_freq: int = 1
    """Environment steps between updates."""
    gradient_steps: int = 1
    """Updates each time."""
    n_steps: int = 3
    """Steps of reward summed before bootstrapping."""
    critic_noise: tuple[float, float] = (0.1, 0.3)
    """Standard deviation of the noise on observations and actions that the critics are fitted to;
    without it they learn the noise of single epochs by heart."""
    target_entropy: float = -1.0
    """Entropy the policy is held to, in nats; SB3's -4 stops exploring before the hand closes."""


@dataclass(frozen=True)
class RunConfig:
    """One training run. A pure function of this object and of the p(error) rows it names."""

    condition: str
    """Training reward: "sparse", "dense" or "rlihf"."""
    seed: int
    """Seeds placement, exploration, networks and the draw of epochs."""
    total_steps: int
    """Environment steps of training (paper: 150,000)."""
    eval_every: int
    """Training steps between two evaluation points."""
    eeg: str = "none"
    """Where p(error) comes from: "simulated", "hri", a folder's name; "none" without feedback."""
    subject: str = ""
    """Held-out subject whose epochs answer the observer; empty without feedback."""
    w_hf: float = 0.0
    """Weight of human feedback in the composite reward; 0 without feedback."""
    p_error_sha256: str = ""
    """Hash of the subject's rows of the p(error) table; empty without feedback."""
    horizon: int = 1000
    """Steps after which an episode of the evaluation is truncated (paper: 1000)."""
    patience: int = 20
    """Steps of training without progress after which an episode is truncated (paper: none)."""
    eval_rollouts: int = 5
    """Rollouts per evaluation point (paper: 5)."""
    observer: str | Callable = "path"
    """Who watches: a name of `observer.OBSERVERS`, or a function `moment -> P(wrong)`."""
    reward: str | Callable = "path"
    """What "dense" adds to the task reward: a name of `rewards.REWARDS`, or a function
    `moment -> float`."""
    feedback: str | Callable = "errp"
    """What p(error) is worth: a name of `rewards.FEEDBACK`, or a function like
    `rewards.errp_reward`."""
    sac: SACSettings = field(default_factory=SACSettings)
    """Hyper-parameters of the learner."""
    timing: Timing = field(default_factory=Timing)
    """When people answer: every step and at once, unless said otherwise."""
    asking: Asking = field(default_factory=Asking)
    """Which steps they are asked about: every one, unless said otherwise."""
    schedule: str = "constant"
    """How the weight changes in the course of training: a name of `schedules.SCHEDULES`."""
    session: int = 1
    """Parts of the rows of p(error), in their order, that as many parts of training draw from."""
    protocol: int = PROTOCOL
    """Version of task, observers, rewards and learner."""

    def __post_init__(self):
        for name, choices in NAMED.items():
            value = getattr(self, name)
            if callable(value) and name in FUNCTIONS:
                # Identified here, where its source is known: workers get the code only.
                function = value if isinstance(value, Given) else given(value)
                object.__setattr__(self, name, function)
            elif value not in choices:
                raise ValueError(f"{name} is {value!r}; choose one of {', '.join(choices)}")
        if (self.condition == "rlihf") != bool(self.subject):
            raise ValueError(
                f"condition {self.condition!r} with subject {self.subject!r}: "
                "rlihf needs a subject, the other conditions take none"
            )
        told = self.timing != Timing(), self.asking != Asking(), self.schedule != "constant"
        if sum(told) > 1:
            raise ValueError("choose one of timing, asking and schedule, not two at once")

    @property
    def run_id(self) -> str:
        """Readable name of the run's folder, such as `rlihf-w0.7-s05-seed3` or `dense-seed0`.

        What differs from the default is named, too: `sparse-patience1000-discount0.98-seed0`,
        `rlihf-w0.7-s05-lay-seed0`, `rlihf-w0.7-s05-my_observer.1f3a9c-seed0`.
        """
        feedback = [f"w{self.w_hf:g}", self.subject] if self.condition == "rlihf" else []
        return "-".join([self.condition, *feedback, *self.changes, f"seed{self.seed}"])

    @property
    def changes(self) -> list[str]:
        """Words for functions and settings that differ from the default, as in the id."""
        changed, words = _changed(self), []
        for word in (changed[name] for name in FUNCTIONS if name in changed):
            words.append(word if isinstance(word, str) else f"{word['name']}.{word['sha256'][:6]}")
        settings = {
            name: changed[name] for name in ("patience", "schedule", "session") if name in changed
        }
        for part in PARTS:
            settings |= changed.get(part, {})
        for name, value in settings.items():
            values = value if isinstance(value, tuple) else (value,)
            words.append(name + "x".join(v if isinstance(v, str) else f"{v:g}" for v in values))
        return words

    def to_dict(self) -> dict[str, Any]:
        """Return the fields as plain JSON values; functions as their name and hash."""
        names = [entry.name for entry in dataclasses.fields(self)]
        fields = {name: _plain(getattr(self, name)) for name in names}
        parts = {name: dataclasses.asdict(getattr(self, name)) for name in PARTS}
        return {**fields, **parts}

    @property
    def hash(self) -> str:
        """Hash of the protocol and of all that isn't left at its default."""
        return sha256(canonical_json({"protocol": self.protocol, **_changed(self)}))


def _plain(value):
    return {"name": value.name, "sha256": value.sha256} if isinstance(value, Given) else value


def _changed(settings):
    """Return the fields of a dataclass that differ from their defaults, as plain values."""
    changed = {}
    for entry in dataclasses.fields(settings):
        value, default = getattr(settings, entry.name), entry.default
        if entry.name in PARTS:
            value, default = _changed(value), {}
        if value != default:
            changed[entry.name] = _plain(value)
    return changed


def is_whole(folder: Path) -> bool:
    """Tell whether a folder holds a finished run, all of it but, at most, the actor.

    A ValueError names a file of it that has changed since (`files.check_sums`).
    """
    return check_sums(folder, may_lack=[ACTOR])


def is_done(config: RunConfig, runs_dir: str | Path) -> bool:
    """Tell whether the run's folder is there and was made from this very config.

    Errors as in `is_whole`.
    """
    folder = Path(runs_dir) / config.run_id
    if not is_whole(folder):
        return False
    return json.loads((folder / "config.json").read_text(encoding="utf-8"))["hash"] == config.hash


def write_run(config: RunConfig, runs_dir: str | Path, files: Mapping[str, bytes]) -> Path:
    """Put a run's files, content by name, in place all at once and return its folder."""
    target = Path(runs_dir) / config.run_id
    temporary = target.with_name(f".{config.run_id}.{os.getpid()}.partial")
    shutil.rmtree(temporary, ignore_errors=True)
    try:
        temporary.mkdir(parents=True)
        for name, content in {**files, SUMS: sums(files).encode()}.items():
            (temporary / name).write_bytes(content)
        # A folder cannot be renamed over another: the old one goes only once the new is complete.
        shutil.rmtree(target, ignore_errors=True)
        temporary.rename(target)
    except OSError as error:
        raise cannot_write(target, error) from error
    finally:
        shutil.rmtree(temporary, ignore_errors=True)
    return target


def read_run(
    config: RunConfig, runs_dir: str | Path, name: str = "eval.csv", columns: Sequence[str] = ()
) -> pd.DataFrame:
    """Read a table of a finished run, "eval.csv" or "train.csv", which must have these columns.

    A FileNotFoundError without the run; a ValueError without a column, return or success.
    """
    path = Path(runs_dir) / config.run_id / name
    if not is_done(config, runs_dir):
        raise FileNotFoundError(
            f"{path.parent} is missing or made from another config; "
            "train it with notebook 03_policy_training or 05_whf_ablation (--only 03 05)"
        )
    frame = pd.read_csv(path, float_precision="round_trip")
    missing = [column for column in columns if column not in frame.columns]
    if missing:
        raise ValueError(f"{path} lacks the column(s) {', '.join(missing)}; delete the run")
    broken = frame["return"].isna() | frame["success"].isna()
    if "episodes" in frame:  # a window of training in which none ended has no means
        broken &= frame["episodes"] > 0
    if broken.any():
        line = broken.idxmax() + 2
        raise ValueError(f"{path}, line {line}: return or success is empty; delete the run")
    return frame
