"""What a reader varies: a study with runs of its own, which never touch those that are shipped."""

import copy
from dataclasses import fields, replace
from typing import Any

from rlihf_lib.files import canonical_json, sha256
from rlihf_lib.rl.runs import RunConfig, SACSettings
from rlihf_lib.study import Study


def choose(people: list[str], subject="") -> str:
    """Return the person whom a notebook shows where one is shown, the first if not named."""
    if subject and subject not in people:
        raise ValueError(f"subject is {subject!r}; choose one of {', '.join(sorted(people))}")
    return subject or people[0]


def vary(
    study: Study,
    subject="",
    w_hf=None,
    seeds=(),
    total_steps=0,
    observer="",
    reward="",
    sac=None,
    weights=(),
) -> Study:
    """Return the study with other runs; the study itself where nothing is varied.

    Parameters
    ----------
    subject : str
        One of the decoded people, whose feedback trains the policies.
    w_hf : float
        Weight of human feedback.
    seeds : sequence of int
    total_steps : int
        Of training.
    observer, reward : str or callable
        By name, or a function of the moment; see `RunConfig`.
    sac : dict
        Values of `SACSettings` by name.
    weights : sequence of float
        Of human feedback, that notebook 05 compares.

    Returns
    -------
    Study
        Its runs, tables and figures lie in `varied/<hash>`. What is left empty is the profile's.

    Raises
    ------
    ValueError
        If a name or value is impossible; says which there are.
    """
    told = {"subject": subject, "w_hf": w_hf, "seeds": tuple(seeds), "total_steps": total_steps,
            "observer": observer, "reward": reward, "sac": sac,
            "weights": tuple(weights)}  # fmt: skip
    told = {n: value for n, value in told.items() if value or (n == "w_hf" and w_hf is not None)}
    if not told:
        return study
    choose(study.ranked_subjects(), subject)
    for name, value in [("w_hf", told.get("w_hf", 0)), *(("weights", w) for w in weights)]:
        if not (isinstance(value, int | float) and 0 <= value <= 10):
            raise ValueError(f"{name}: {value!r} is no weight; give a number from 0 to 10")
    if len(weights) == 1:
        raise ValueError(f"weights: {weights!r} is one; notebook 05 compares two or more")
    if not all(isinstance(seed, int) and seed >= 0 for seed in seeds):
        raise ValueError(f"seeds are {seeds!r}; give whole numbers, 0 or more")
    every = study.profile.eval_every
    if not isinstance(total_steps, int) or total_steps < 0 or total_steps % every:
        raise ValueError(
            f"total_steps is {total_steps!r}; give a multiple of {every}, after each of which "
            "policies are evaluated"
        )
    known = [field.name for field in fields(SACSettings)]
    if unknown := set(sac or ()) - set(known):
        raise ValueError(f"sac has no {', '.join(unknown)}; it has {', '.join(known)}")
    varied = copy.copy(study)
    varied.subject = subject
    varied.changes = {name: told[name] for name in ("observer", "reward") if name in told}
    if sac:
        varied.changes["sac"] = SACSettings(**sac)
    sizes: dict[str, Any] = {
        name: told[name] for name in ("w_hf", "total_steps", "seeds", "weights") if name in told
    }
    if seeds:
        sizes["ablation_seeds"] = told["seeds"]
    # These stand beside the profile's runs.
    sizes |= {"tuned_seeds": (), "ideal_seeds": (), "control_seeds": ()}
    words = ", ".join(f"{name} {_word(value)}" for name, value in told.items())
    varied.profile = replace(study.profile, name=f"{study.profile.name}, {words}", **sizes)
    settings = RunConfig("dense", 0, varied.profile.total_steps, every, **varied.changes).hash
    key = sha256(canonical_json([subject, sizes, settings]))[:8]
    varied.results = study.results / "varied" / key
    varied.runs, varied.tables, varied.figures = (
        varied.results / name for name in ("runs", "tables", "figures")
    )
    return varied


def _word(value):
    if isinstance(value, tuple):
        return " ".join(map(str, value))
    return getattr(value, "__name__", value)
