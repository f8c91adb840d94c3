"""Beyond the paper: what feedback must be like for a robot to learn from it, in experiments.

An experiment varies one thing: its *cases*, by name, are runs of a few seeds each. All have the
study's learner, task and main weight, and the feedback of the person with the median decoder unless
something else is varied. They lie in the folder `beyond` of the study.
"""

from collections.abc import Callable

import numpy as np
import pandas as pd
from scipy.special import expit, logit

from rlihf_lib.profiles import Profile
from rlihf_lib.report.evaluations import load_runs, phase_scores
from rlihf_lib.rl.feedback import IDEAL, controls_of, p_error_sha256, synthetic_table
from rlihf_lib.rl.observer import SURE_PROGRESS, comfort, progress
from rlihf_lib.rl.runs import RunConfig
from rlihf_lib.rl.timing import Timing
from rlihf_lib.task.moment import Moment

STEPS, EVERY, SEEDS = 60_000, 5_000, (0, 1, 2)  # of studies at least as long
D_PRIMES = (0.5, 1.0, 1.5, 2.0, 3.0)  # distances of the classes, in standard deviations
PRIOR = 0.35  # share of errors that synthetic decoders expect
BIASED = 1.5  # d' of the decoders whose calibration is spoilt
#: How: evidence, log-odds less those of the prior, is multiplied, and something is added to it.
BIASES = {"blaming": (1, 2), "praising": (1, -2), "timid": (0.3, 0), "bold": (3, 0)}
INTERVALS, DELAYS = (1, 3, 10), (0, 3, 8)  # steps of 0.1 s
SLOWEST = {"interval": 10, "delay": 8}  # an answer a second, 0.8 s late


def half(p_error: np.ndarray, share: float, doubt: float) -> np.ndarray:
    """Feedback about zero: 0.5 - p."""
    return 0.5 - p_error


def log_odds(p_error: np.ndarray, share: float, doubt: float) -> np.ndarray:
    """Feedback by the evidence: log-odds of being right, at most 3 either way."""
    return np.clip(-logit(np.clip(p_error, 1e-3, 1 - 1e-3)), -3, 3)


def yes_or_no(p_error: np.ndarray, share: float, doubt: float) -> np.ndarray:
    """Feedback by the decision alone: 1 if p is below one half, else 0."""
    return (p_error < 0.5) * 1.0


def fading(p_error: np.ndarray, share: float, doubt: float) -> np.ndarray:
    """Feedback that falls to nothing in the course of training."""
    return (1 - share) * (1 - p_error)


def growing(p_error: np.ndarray, share: float, doubt: float) -> np.ndarray:
    """Feedback that counts ever more."""
    return share * (1 - p_error)


def doubting(p_error: np.ndarray, share: float, doubt: float) -> np.ndarray:
    """Feedback that counts as far as the critics disagree, fully from a tenth of the values on."""
    return min(10 * doubt, 1.0) * (1 - p_error)


def planner(moment: Moment) -> float:
    """P(wrong) of somebody who wants progress and minds no obstacle but a collision."""
    if moment.success:
        return 0.0
    return 1.0 - progress(moment)


def wary(moment: Moment) -> float:
    """P(wrong) of somebody at ease only from 8 cm on, who is content with half the progress."""
    if moment.success:
        return 0.0
    return 1.0 - progress(moment, SURE_PROGRESS / 2) * comfort(moment.clearance - 0.03)


def hates_speed(moment: Moment) -> float:
    """P(wrong) of somebody whom more than 1 cm a step frightens."""
    if moment.success:
        return 0.0
    slow = moment.best - moment.remaining < 0.01
    return 1.0 - progress(moment, SURE_PROGRESS / 2) * comfort(moment.clearance) * slow


class Beyond:
    """Runs and p(error) of the experiments of a study, which has the decoders; see `EXPERIMENTS`.

    As long as the study's, or 60,000 steps, and with three seeds then.
    """

    def __init__(self, study):
        profile = study.profile
        is_long = profile.total_steps >= STEPS
        self.study, self.runs = study, study.results / "beyond" / "runs"
        self.person = study.median_subject()
        self.seeds = SEEDS if is_long else profile.seeds[:1]
        self._sizes = {
            "total_steps": STEPS if is_long else profile.total_steps,
            "eval_every": EVERY if is_long else profile.eval_every,
            "horizon": profile.horizon, "eval_rollouts": profile.eval_rollouts,
        }  # fmt: skip
        self.p_error = pd.concat([study.feedback(), *_synthetic()], ignore_index=True)

    def cases(self, experiment: str) -> dict[str, list[RunConfig]]:
        """Runs of one of `EXPERIMENTS` by case, the case that others are compared with first."""
        return {
            name: self._runs(**varied) for name, varied in EXPERIMENTS[experiment](self).items()
        }

    def run_configs(self, experiment: str) -> list[RunConfig]:
        """All runs of an experiment, as `Study.run_configs`."""
        return [config for runs in self.cases(experiment).values() for config in runs]

    def late(self, experiment: str) -> pd.DataFrame:
        """Average each finished run over the last third of its training, with its case."""
        named = {c.run_id: case for case, runs in self.cases(experiment).items() for c in runs}
        means = phase_scores(load_runs(self, [experiment]))
        case = pd.Categorical(means["run"].map(named), list(dict.fromkeys(named.values())))
        return means.assign(case=case).sort_values(["case", "seed"], ignore_index=True)

    def _runs(self, subject="", w_hf=Profile.w_hf, **changes):
        subject = subject or self.person
        digest = p_error_sha256(self.p_error, subject)
        named = {"eeg": self.study.eeg_name, "subject": subject, "p_error_sha256": digest}
        return [
            RunConfig("rlihf", seed, w_hf=w_hf, **named, **self._sizes, **changes)
            for seed in self.seeds
        ]


def _synthetic():
    """Tables of synthetic decoders: by d', and of one d' with its calibration spoilt."""
    for d in D_PRIMES:
        yield synthetic_table(d, PRIOR).assign(subject=f"d{d:g}")
    table = synthetic_table(BIASED, PRIOR)
    evidence = logit(table["p_error"]) - logit(PRIOR)
    for name, (factor, shift) in BIASES.items():
        p_error = expit(factor * evidence + shift + logit(PRIOR))
        yield table.assign(subject=f"d{BIASED:g}_{name}", p_error=p_error)


def _ladder(beyond):
    constant, shuffled = controls_of(beyond.person)
    synthetic = {f"d' = {d:g}": {"subject": f"d{d:g}"} for d in D_PRIMES}
    return {
        "ideal": {"subject": IDEAL}, "constant": {"subject": constant},
        "shuffled": {"subject": shuffled}, **synthetic,
    }  # fmt: skip


def _bias(beyond):
    names = ["", *(f"_{name}" for name in BIASES)]
    return {name[1:] or "calibrated": {"subject": f"d{BIASED:g}{name}"} for name in names}


def _lateness(beyond):
    """What a learner does that knows nothing of delays."""
    grid = [(interval, delay) for interval in INTERVALS for delay in DELAYS]
    naive = {(i, d): Timing(i, d, credit="arrival") if i + d > 1 else Timing() for i, d in grid}
    return {
        f"every {i}, {d} late": {"subject": IDEAL, "timing": timing}
        for (i, d), timing in naive.items()
    }


def _remedies(beyond):
    at_once = {"at once": {"subject": IDEAL}}
    late = {
        credit: {"subject": IDEAL, "timing": Timing(**SLOWEST, credit=credit)}
        for credit in ("arrival", "held", "event", "window", "kernel")
    }
    jitter = Timing(**SLOWEST, jitter=4, credit="kernel")
    own = {f"event, {beyond.person}": {"timing": Timing(**SLOWEST, credit="event")}}
    return at_once | late | {"kernel, jitter": {"subject": IDEAL, "timing": jitter}} | own


def _forms(beyond):
    """Forms of the same answers, scaled so that right and wrong steps differ alike on average."""
    rows = beyond.p_error[beyond.p_error["subject"] == beyond.person]
    right, wrong = (rows.loc[rows["label"] == label, "p_error"] for label in (0, 1))
    cases: dict[str, dict] = {"1 - p": {}}
    for name, form in (("0.5 - p", half), ("log-odds", log_odds), ("yes or no", yes_or_no)):
        contrast = form(right, 0.0, 0.0).mean() - form(wrong, 0.0, 0.0).mean()
        weight = Profile.w_hf * (wrong.mean() - right.mean()) / contrast
        cases[name] = {"feedback": form, "w_hf": float(f"{weight:.3g}")}
    return cases


def _weights(beyond):
    fixed = {f"always {w:g}": {"w_hf": w} for w in sorted(Profile.weights, reverse=True)}
    return fixed | {f.__name__: {"feedback": f} for f in (fading, growing, doubting)}


def _observers(beyond):
    """Whose preferences: an ideal decoder, so that they alone differ."""
    watchers = {"path": "path", "lay": "lay"} | {
        f.__name__: f for f in (planner, wary, hates_speed)
    }
    return {name: {"subject": IDEAL, "observer": watcher} for name, watcher in watchers.items()}


#: By name, what the cases of each vary.
EXPERIMENTS: dict[str, Callable[[Beyond], dict[str, dict]]] = {
    "ladder": _ladder, "bias": _bias, "lateness": _lateness, "remedies": _remedies,
    "forms": _forms, "weights": _weights, "observers": _observers,
}  # fmt: skip
