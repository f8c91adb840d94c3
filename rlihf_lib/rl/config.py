"""What determines a run: its config, its readable id, its hash."""

import dataclasses
from collections.abc import Callable
from dataclasses import dataclass, field

from rlihf_lib.files import canonical_json, sha256
from rlihf_lib.rl.functions import Given, given
from rlihf_lib.rl.observer import OBSERVERS
from rlihf_lib.rl.rewards import REWARDS

CONDITIONS = ("sparse", "dense", "rlihf")
# Raised by whoever changes task, observer, rewards or learner, or a default below, so that results
# change: runs of an earlier protocol then count as missing.
PROTOCOL = 6


@dataclass(frozen=True)
class SACSettings:
    """Hyper-parameters of every run, the same for all conditions."""

    hidden: tuple[int, int] = (128, 128)
    """Units of the two hidden layers of actor and critics."""
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
    sac: SACSettings = field(default_factory=SACSettings)
    """Hyper-parameters of the learner."""
    protocol: int = PROTOCOL
    """Version of task, observers, rewards and learner."""

    def __post_init__(self):
        known = {"condition": CONDITIONS, "observer": OBSERVERS, "reward": REWARDS}
        for name, choices in known.items():
            value = getattr(self, name)
            if callable(value) and name != "condition":
                if not isinstance(value, Given):
                    # Identified here, where its source is known: workers get the code only.
                    object.__setattr__(self, name, given(value))
            elif value not in choices:
                raise ValueError(f"{name} is {value!r}; choose one of {', '.join(choices)}")
        if (self.condition == "rlihf") != bool(self.subject):
            raise ValueError(
                f"condition {self.condition!r} with subject {self.subject!r}: "
                "rlihf needs a subject, the other conditions take none"
            )

    @property
    def run_id(self):
        """Readable name of the run's folder, such as `rlihf-w0.7-s05-seed3` or `dense-seed0`.

        What differs from the default is named, too: `sparse-patience1000-discount0.98-seed0`,
        `rlihf-w0.7-s05-lay-seed0`, `rlihf-w0.7-s05-my_observer.1f3a9c-seed0`.
        """
        parts = [self.condition]
        if self.condition == "rlihf":
            parts += [f"w{self.w_hf:g}", self.subject]
        changed = _changed(self)
        for name in ("observer", "reward"):
            given = changed.get(name)
            if isinstance(given, dict):
                given = f"{given['name']}.{given['sha256'][:6]}"
            parts += [given] if given else []
        settings = {"patience": changed.get("patience"), **changed.get("sac", {})}
        for name, value in settings.items():
            if value is not None:
                values = value if isinstance(value, tuple) else (value,)
                parts.append(name + "x".join(f"{v:g}" for v in values))
        return "-".join([*parts, f"seed{self.seed}"])

    def to_dict(self):
        """Return the fields as plain JSON values; functions as their name and hash."""
        fields = {
            entry.name: _plain(getattr(self, entry.name)) for entry in dataclasses.fields(self)
        }
        return {**fields, "sac": dataclasses.asdict(self.sac)}

    @property
    def hash(self):
        """Hash of the protocol and of everything that isn't left at its default.

        Present and equal in a run folder means done. An option added later, left at its default,
        leaves it alone.
        """
        return sha256(canonical_json({"protocol": self.protocol, **_changed(self)}))


def _plain(value):
    return {"name": value.name, "sha256": value.sha256} if isinstance(value, Given) else value


def _changed(settings):
    """Return the fields of a dataclass that differ from their defaults, as plain values."""
    changed = {}
    for entry in dataclasses.fields(settings):
        value = getattr(settings, entry.name)
        if entry.name == "sac":
            value, default = _changed(value), {}
        else:
            default = entry.default
        if value != default:
            changed[entry.name] = _plain(value)
    return changed
