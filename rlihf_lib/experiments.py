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
WEAK = 1.0  # d' of one also heard at a weight at which right and wrong steps differ as at BIASED
#: How: evidence, log-odds less those of the prior, is multiplied, and something is added to it.
BIASES = {"blaming": (1, 2), "timid": (0.3, 0)}
INTERVALS, DELAYS = (1, 3, 10), (0, 3, 8)  # steps of 0.1 s
SLOWEST = {"interval": 10, "delay": 8}  # an answer a second, 0.8 s late
BUDGETS = (2_000, 10_000)  # answers in a run, of 60,000 steps


def synthetic_tables() -> Iterator[pd.DataFrame]:
    """Tables of synthetic decoders: by d', and of one d' with its calibration spoilt."""
    for d in D_PRIMES:
        yield synthetic_table(d, PRIOR).assign(subject=_synthetic_name(d))
    table = synthetic_table(BIASED, PRIOR)
    evidence = logit(table["p_error"]) - logit(PRIOR)
    for name, (factor, shift) in BIASES.items():
        p_error = expit(factor * evidence + shift + logit(PRIOR))
        yield table.assign(subject=f"{_synthetic_name(BIASED)}_{name}", p_error=p_error)


def _synthetic_name(d):
    return f"d{d:.1f}"  # people's names have no dot


def contrast(rows: pd.DataFrame, form: Callable = errp_reward) -> float:
    """By how much more right steps are worth than wrong ones, on average, by rows of p(error)."""
    right, wrong = (
        form(rows.loc[rows["label"] == label, "p_error"].to_numpy(), 0.0).mean() for label in (0, 1)
    )
    return right - wrong


def _ladder(beyond):
    constant, shuffled = controls_of(beyond.person)
    synthetic = {f"d' = {d:g}": {"subject": _synthetic_name(d)} for d in D_PRIMES}
    return {
        "ideal": {"subject": IDEAL}, "constant": {"subject": constant},
        "shuffled": {"subject": shuffled}, **synthetic,
        f"d' = {WEAK:g}, matched": _matched(beyond, _synthetic_name(WEAK), f"d' = {WEAK:g}"),
    }  # fmt: skip


def _matched(beyond, subject, against):
    """Of p(error) that differs little between right and wrong: the weight that makes up for it."""
    told, spoilt = (
        contrast(rows_of(beyond.p_error, one)) for one in (_synthetic_name(BIASED), subject)
    )
    weight = float(f"{Profile.w_hf * told / spoilt:.3g}")
    return {"subject": subject, "w_hf": weight, "against": against}


def _bias(beyond):
    """The same evidence told otherwise, and errors of the decoder that depend on what is done."""
    calibrated = _synthetic_name(BIASED)
    cases: dict[str, dict] = {"calibrated": {"subject": calibrated}}
    cases |= {name: {"subject": f"{calibrated}_{name}"} for name in BIASES}
    cases["timid, matched"] = _matched(beyond, f"{calibrated}_timid", "timid")
    for watcher in (forms.blind, forms.jumpy):
        cases[watcher.__name__] = {"subject": calibrated, "observer": watcher}
    return cases


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
    slow["kernel, jitter"] = {"timing": Timing(**SLOWEST, jitter=4, credit="kernel")}
    mended = [name for name in slow if name != "arrival"]
    budget = beyond.sizes["total_steps"] // SLOWEST["interval"]
    model = {"asking": Asking(budget, model=True)}  # is fitted every 100 s: no delay counts
    weighed = event | {"w_hf": Profile.w_hf / SLOWEST["interval"]}
    return {
        "at once": ideal, "arrival": ideal | slow["arrival"],
        **{name: ideal | slow[name] | {"against": "arrival"} for name in mended},
        "event, weight 0.07": ideal | weighed | {"against": "event"},
        "event, model": ideal | model | {"against": "event"},
        f"at once, {me}": {},
        f"event, {me}": event | {"against": f"at once, {me}"},
        f"event, model, {me}": model | {"against": f"event, {me}"},
    }  # fmt: skip


def _labels(beyond):
    """How many answers it takes, and what a model of them adds."""
    cases: dict[str, dict] = {
        "every step": {"asking": Asking()}, "every step, model": {"asking": Asking(model=True)}
    }  # fmt: skip
    budgets = {"each epoch once": {"once": True}} | {f"{n:,}": {"budget": n} for n in BUDGETS}
    for words, budget in budgets.items():
        model, unsure = (Asking(**budget, model=True, when=when) for when in ("spread", "unsure"))
        cases[f"{words}, model"] = {"asking": model}
        cases[f"{words}, unsure"] = {"asking": unsure, "against": f"{words}, model"}
    most = f"{BUDGETS[-1]:,}"
    cases[f"{most}, model"]["against"] = most
    return cases | {most: {"asking": Asking(BUDGETS[-1])}}


def _forms(beyond):
    """Forms of the same answers, scaled so that right and wrong steps differ alike on average.

    And each at half and at twice this scale; but 0.5 - p, which is 1 - p less a constant, only
    tells how much is luck.
    """
    rows = rows_of(beyond.p_error, beyond.person)
    cases: dict[str, dict] = {}
    for name, form in (
        ("1 - p", errp_reward), ("0.5 - p", forms.half), ("log-odds", forms.log_odds),
        ("yes or no", forms.yes_or_no),
    ):  # fmt: skip
        told = {"feedback": "errp" if form is errp_reward else form}
        weight = Profile.w_hf * contrast(rows) / contrast(rows, form)
        scales = {"": 1.0} if form is forms.half else {"": 1, ", half": 0.5, ", twice": 2}
        for words, scale in scales.items():
            cases[name + words] = told | {"w_hf": float(f"{scale * weight:.3g}")}
    return cases


def _weights(beyond):
    """Fixed weights, some that change in training, one by doubt, one by how far p(error) spreads.

    The spread needs no labels, and is small where a decoder knows little.
    """
    fixed: dict[str, dict[str, Any]] = {
        f"always {w:g}": {"w_hf": w} for w in sorted(Profile.weights, reverse=True)
    }
    changing: dict[str, dict[str, Any]] = {
        **{name: {"schedule": name, "against": "always 0.4"} for name in ("fading", "growing")},
        "0.5 - p": {"feedback": forms.half},
        "0.5 - p, by doubt": {"feedback": forms.doubting, "against": "0.5 - p"},
    }
    who = weaker(beyond)
    spread, usual = (rows_of(beyond.p_error, one)["p_error"].std() for one in (who, beyond.person))
    weight = float(f"{Profile.w_hf * spread / usual:.3g}")
    theirs = f"always {Profile.w_hf:g}, {who}"
    by_spread = {"subject": who, "w_hf": weight, "against": theirs}
    return fixed | {theirs: {"subject": who}} | changing | {f"by spread, {who}": by_spread}


def weaker(beyond) -> str:
    """Name the person a quarter up from the weakest decoder, with whom there is room either way."""
    ranked = beyond.study.ranked_subjects()
    return ranked[round((len(ranked) - 1) / 4)]


def _observers(beyond):
    """Whose preferences: an ideal decoder, so that they alone differ."""
    watchers = {"path": "path", "lay": "lay"} | {
        f.__name__: f for f in (forms.planner, forms.wary, forms.hates_speed)
    }
    return {name: {"subject": IDEAL, "observer": watcher} for name, watcher in watchers.items()}


def _tiring(beyond):
    """A session in which the person tires, and a decoder that is, or isn't, kept up to date."""
    from rlihf_lib.eeg.tiring import PARTS  # imports MNE, so only when asked

    if beyond.study.eeg != "simulated":
        raise ValueError(f"nobody tires in {beyond.study.eeg_label}: only simulated people do")
    states: dict[str, dict] = {"rested": {}, "tired": {}, "updated": {"against": "tired"}}
    return {
        state: {"subject": f"{beyond.person}_{state}", "session": PARTS, **told}
        for state, told in states.items()
    }


#: By name, what the cases of each vary.
EXPERIMENTS: dict[str, Callable[[Any], dict[str, dict]]] = {
    "ladder": _ladder, "bias": _bias, "lateness": _lateness, "remedies": _remedies,
    "labels": _labels, "forms": _forms, "weights": _weights, "observers": _observers,
    "tiring": _tiring,
}  # fmt: skip
#: Cases of each.
N_CASES = {
    "ladder": 9, "bias": 6, "lateness": 9, "remedies": 12, "labels": 9, "forms": 10, "weights": 9,
    "observers": 5, "tiring": 3,
}  # fmt: skip


def against(beyond, experiment: str) -> dict[str, str]:
    """What cases of an experiment are compared with, where that isn't the first one."""
    cases = EXPERIMENTS[experiment](beyond).items()
    return {name: case["against"] for name, case in cases if "against" in case}
