"""The experiments of notebook 06: what the cases of each vary.

Each is a function of a `beyond.Beyond` that returns, by name, what makes a case: fields of
`RunConfig`, and under "against" the case that it is compared with, where that isn't the first one.
"""

from collections.abc import Callable, Iterator
from typing import Any

import pandas as pd
from scipy.special import expit, logit

from rlihf_lib.profiles import Profile
from rlihf_lib.rl import forms
from rlihf_lib.rl.asking import Asking
from rlihf_lib.rl.feedback import IDEAL, controls_of, rows_of, synthetic_table
from rlihf_lib.rl.rewards import errp_reward
from rlihf_lib.rl.timing import Timing

D_PRIMES = (0.5, 1.0, 1.5, 2.0, 3.0)  # distances of the classes, in standard deviations
PRIOR = 0.35  # share of errors that synthetic decoders expect
BIASED = 1.5  # d' of the decoders whose calibration is spoilt
#: How: evidence, log-odds less those of the prior, is multiplied, and something is added to it.
BIASES = {"blaming": (1, 2), "timid": (0.3, 0)}
INTERVALS, DELAYS = (1, 3, 10), (0, 3, 8)  # steps of 0.1 s
SLOWEST = {"interval": 10, "delay": 8}  # an answer a second, 0.8 s late
BUDGETS = (2_000, 10_000)  # answers in a run, of 60,000 steps


def made_up_tables(p_error: pd.DataFrame, person: str) -> pd.DataFrame:
    """p(error) of synthetic decoders, by d' and with spoilt calibration, and a person's calibrated.

    Runs are named by the hash of their rows: nine digits are the same on every processor.
    """
    tables = [*_synthetic_tables(), _calibrated(rows_of(p_error, person))]
    return pd.concat(tables, ignore_index=True).round({"p_error": 9})


def _synthetic_tables() -> Iterator[pd.DataFrame]:
    for d in D_PRIMES:
        yield synthetic_table(d, PRIOR).assign(subject=_synthetic_name(d))
    table = synthetic_table(BIASED, PRIOR)
    evidence = logit(table["p_error"]) - logit(PRIOR)
    for name, (factor, shift) in BIASES.items():
        p_error = expit(factor * evidence + shift + logit(PRIOR))
        yield table.assign(subject=f"{_synthetic_name(BIASED)}_{name}", p_error=p_error)


def _calibrated(rows):
    """Calibrate p(error) by the labels of the very epochs (Platt 1999): as good as it can get."""
    from sklearn.linear_model import LogisticRegression  # slow to import, so only when asked

    evidence = logit(rows[["p_error"]].clip(1e-3, 1 - 1e-3)).to_numpy()
    fitted = LogisticRegression(C=1e3, solver="newton-cholesky").fit(evidence, rows["label"])
    name = f"{rows['subject'][0]}_calibrated"
    return rows.assign(subject=name, p_error=fitted.predict_proba(evidence)[:, 1])


def _synthetic_name(d):
    return f"d{d:.1f}"  # people's names have no dot


def contrast(rows: pd.DataFrame, form: Callable = errp_reward) -> float:
    """By how much more right steps are worth than wrong ones, on average, by rows of p(error)."""
    right, wrong = (
        form(rows.loc[rows["label"] == label, "p_error"].to_numpy()).mean() for label in (0, 1)
    )
    return right - wrong


def _ladder(beyond):
    constant, shuffled = controls_of(beyond.person)
    synthetic = {f"d' = {d:g}": {"subject": _synthetic_name(d)} for d in D_PRIMES}
    return {
        "ideal": {"subject": IDEAL}, "constant": {"subject": constant},
        "shuffled": {"subject": shuffled}, **synthetic,
    }  # fmt: skip


def _bias(beyond):
    """The same evidence told otherwise, and errors of the decoder that depend on what is done.

    A timid decoder tells right from wrong by little: matched is the weight that makes up for it.
    """
    calibrated = _synthetic_name(BIASED)
    biased = {name: {"subject": f"{calibrated}_{name}"} for name in BIASES}
    told, spoilt = (contrast(rows_of(beyond.p_error, who))
                    for who in (calibrated, biased["timid"]["subject"]))  # fmt: skip
    matched = {"w_hf": _three_digits(Profile.w_hf * told / spoilt), "against": "timid"}
    return {
        "calibrated": {"subject": calibrated}, **biased,
        "timid, matched": biased["timid"] | matched,
        "jumpy": {"subject": calibrated, "observer": forms.jumpy},
    }  # fmt: skip


def _three_digits(weight):
    return float(f"{weight:.3g}")  # which name a run's folder


def _lateness(beyond):
    """What a learner does that knows nothing of delays."""
    grid = [(interval, delay) for interval in INTERVALS for delay in DELAYS]
    naive = {(i, d): Timing(i, d, credit="arrival") if i + d > 1 else Timing() for i, d in grid}
    return {
        f"every {i}, {d} late": {"subject": IDEAL, "timing": timing}
        for (i, d), timing in naive.items()
    }


def _remedies(beyond):
    credits = ("arrival", "held", "event", "window", "kernel")
    slow = {credit: {"timing": Timing(**SLOWEST, credit=credit)} for credit in credits}
    ideal, event, me = {"subject": IDEAL}, slow["event"], beyond.person
    jitter = {"timing": Timing(**SLOWEST, jitter=4, credit="kernel"), "against": "kernel"}
    return {
        "at once": ideal, "arrival": ideal | slow["arrival"],
        **{name: ideal | slow[name] | {"against": "arrival"} for name in credits[1:]},
        "kernel, jitter": ideal | jitter,
        f"at once, {me}": {},
        f"event, {me}": event | {"against": f"at once, {me}"},
    }  # fmt: skip


def _labels(beyond):
    """How many answers it takes, and what a model of them adds."""
    cases: dict[str, dict] = {
        "every step": {"asking": Asking()}, "every step, model": {"asking": Asking(model=True)}
    }  # fmt: skip
    few, many = (f"{n:,}" for n in BUDGETS)
    for words, budget in (("each epoch once", {"once": True}), (few, {"budget": BUDGETS[0]})):
        model, unsure = (Asking(**budget, model=True, when=when) for when in ("spread", "unsure"))
        cases[f"{words}, model"] = {"asking": model}
        cases[f"{words}, unsure"] = {"asking": unsure, "against": f"{words}, model"}
    cases[many] = {"asking": Asking(BUDGETS[1])}
    return cases | {f"{many}, model": {"asking": Asking(BUDGETS[1], model=True), "against": many}}


def _forms(beyond):
    """Forms of the same answers, scaled so that right and wrong steps differ alike on average.

    And each at half and at twice this scale; but 0.5 - p, which is 1 - p less a constant, only
    tells how much is luck.
    """
    me, calibrated = beyond.person, f"{beyond.person}_calibrated"
    cases: dict[str, dict] = {}
    for name, who, form in (
        ("1 - p", me, errp_reward), ("0.5 - p", me, forms.half), ("log-odds", me, forms.log_odds),
        ("yes or no", me, forms.yes_or_no), ("calibrated", calibrated, errp_reward),
    ):  # fmt: skip
        told = {"subject": who, "feedback": "errp" if form is errp_reward else form}
        usual, here = contrast(rows_of(beyond.p_error, me)), rows_of(beyond.p_error, who)
        weight = Profile.w_hf * usual / contrast(here, form)
        scales = {"": 1.0} if form is forms.half else {"": 1, ", half": 0.5, ", twice": 2}
        for words, scale in scales.items():
            cases[name + words] = told | {"w_hf": _three_digits(scale * weight)}
    return cases


def _weights(beyond):
    """Fixed weights, two that follow the time, and one that follows the critics' doubt."""
    fixed: dict[str, dict[str, Any]] = {
        f"always {w:g}": {"w_hf": w} for w in sorted(Profile.weights, reverse=True)
    }
    changing = {"fading": "fading", "growing": "growing", "by doubt": "doubt"}
    return fixed | {
        name: {"schedule": schedule, "against": "always 0.4"} for name, schedule in changing.items()
    }


def _observers(beyond):
    """Whose preferences: an ideal decoder, so that they alone differ."""
    watchers = {"path": "path", "lay": "lay"} | {
        f.__name__: f for f in (forms.planner, forms.wary, forms.hates_speed)
    }
    return {name: {"subject": IDEAL, "observer": watcher} for name, watcher in watchers.items()}


def _tiring(beyond):
    """A session in which the person tires, at a weight that follows the spread of p(error), or not.

    And with a decoder that is kept up to date.
    """
    from rlihf_lib.eeg.tiring import PARTS, STATES  # imports MNE, so only when asked

    if beyond.study.eeg != "simulated":
        raise ValueError(f"nobody tires in {beyond.study.eeg_label}: only simulated people do")
    rested, tired, updated = (
        {"subject": f"{beyond.person}_{state}", "session": PARTS} for state in STATES
    )
    by_spread = tired | {"schedule": "spread", "against": "tired"}
    return {
        "rested": rested, "tired": tired, "tired, by spread": by_spread,
        "updated": updated | {"against": "tired"},
    }  # fmt: skip


#: By name, what the cases of each vary.
EXPERIMENTS: dict[str, Callable[[Any], dict[str, dict]]] = {
    "ladder": _ladder, "bias": _bias, "lateness": _lateness, "remedies": _remedies,
    "labels": _labels, "forms": _forms, "weights": _weights, "observers": _observers,
    "tiring": _tiring,
}  # fmt: skip
#: Cases of each.
N_CASES = {
    "ladder": 8, "bias": 5, "lateness": 9, "remedies": 9, "labels": 8, "forms": 13, "weights": 6,
    "observers": 5, "tiring": 4,
}  # fmt: skip


def against(beyond, experiment: str) -> dict[str, str]:
    """What cases of an experiment are compared with, where that isn't the first one."""
    cases = EXPERIMENTS[experiment](beyond).items()
    return {name: case["against"] for name, case in cases if "against" in case}
