"""Beyond the paper: what feedback must be like for a robot to learn from it, in experiments.

An experiment varies one thing: its *cases*, by name, are runs of a few seeds each. All have the
study's learner, task and main weight, and the feedback of the person with the median decoder unless
something else is varied (`experiments`). They lie in the folder `beyond` of the study.
"""

from functools import cached_property
from typing import Any

import pandas as pd

from rlihf_lib.experiments import EXPERIMENTS, N_CASES, made_up_tables
from rlihf_lib.files import SUMS, check_sums, sha256, write_csv, write_sums
from rlihf_lib.profiles import Profile
from rlihf_lib.rl.feedback import p_error_sha256, read_table
from rlihf_lib.rl.runs import RunConfig, is_done

STEPS, EVERY, SEEDS = 60_000, 5_000, (0, 1, 2)  # of studies at least as long
FEW = 10  # of shorter ones, which part of their steps, and of one seed


class Beyond:
    """Runs and p(error) of the experiments of a study, which has the decoders.

    Those of long studies are of 60,000 steps and three seeds, those of small ones are tiny.
    """

    def __init__(self, study):
        self.study, self.runs = study, study.results / "beyond" / "runs"
        self.person = study.median_subject()
        self.seeds, self.sizes = seeds_and_sizes(study.profile)

    @cached_property
    def p_error(self) -> pd.DataFrame:
        """p(error) of the study's people and controls, and of decoders that are made up."""
        known = self.study.feedback()
        made_up = made_up_tables(known, self.person)
        return pd.concat([known, made_up], ignore_index=True)

    @cached_property
    def session(self) -> pd.DataFrame:
        """p(error) over a session in which the person tires; only simulated people can."""
        # Imports MNE, so only when asked.
        from rlihf_lib.eeg.loso import load_decoder
        from rlihf_lib.eeg.tiring import SETTINGS, session_table

        # A decoder trained anew decodes anew.
        made_from = sha256((self.study.decoder / SUMS).read_bytes() + repr(SETTINGS).encode())
        folder = self.runs.parent / f"session-{self.person}-{made_from[:8]}"
        if not check_sums(folder):
            table = session_table(self.person, load_decoder(self.study.decoder, self.person))
            write_csv(folder / "p_error.csv", table)
            write_sums(folder, ["p_error.csv"])
        return read_table(folder / "p_error.csv")

    def cases(self, experiment: str) -> dict[str, list[RunConfig]]:
        """Runs of one of `EXPERIMENTS` by case, the case that others are compared with first."""
        table = self._table(experiment)
        varied = EXPERIMENTS[experiment](self)
        return {name: self._runs(table, **changes) for name, changes in varied.items()}

    def _table(self, experiment):
        return self.session if experiment == "tiring" else self.p_error

    def run_configs(self, experiment: str) -> list[RunConfig]:
        """All runs of an experiment, as `Study.run_configs`."""
        return [config for runs in self.cases(experiment).values() for config in runs]

    def learn(self, experiment: str, workers: int = 0, recompute: bool = False) -> pd.DataFrame:
        """Train the runs of an experiment that are missing, as `rl.sweep.run_sweep`; see `late`."""
        from rlihf_lib.rl.sweep import run_sweep  # imports Dask, so only when asked

        table = self._table(experiment)
        run_sweep(self.run_configs(experiment), self.runs, table, workers, recompute)
        return self.late(experiment)

    def late(self, experiment: str) -> pd.DataFrame:
        """Average each finished run over the last third of its training, with its case."""
        # Imports Matplotlib, which writes to the home folder unless told where else.
        from rlihf_lib.report.evaluations import load_runs, phase_scores

        named = {c.run_id: case for case, runs in self.cases(experiment).items() for c in runs}
        means = phase_scores(load_runs(self, [experiment]))
        case = pd.Categorical(means["run"].map(named), list(dict.fromkeys(named.values())))
        return means.assign(case=case).sort_values(["case", "seed"], ignore_index=True)

    def _runs(self, table, subject="", w_hf=Profile.w_hf, against="", **changes):
        subject = subject or self.person
        digest = p_error_sha256(table, subject)
        named = {"eeg": self.study.eeg_name, "subject": subject, "p_error_sha256": digest}
        return [
            RunConfig("rlihf", seed, w_hf=w_hf, **named, **self.sizes, **changes)
            for seed in self.seeds
        ]


def seeds_and_sizes(profile: Profile) -> tuple[tuple[int, ...], dict[str, Any]]:
    """Seeds of each case in a profile, and the sizes of its runs, as fields of `RunConfig`."""
    sizes = {name: getattr(profile, name) for name in ("horizon", "eval_rollouts")}
    if profile.total_steps >= STEPS:
        return SEEDS, {"total_steps": STEPS, "eval_every": EVERY, **sizes}
    few = {name: getattr(profile, name) // FEW for name in ("total_steps", "eval_every")}
    return profile.seeds[:1], few | sizes


def planned(study) -> tuple[str, ...]:
    """Name the experiments of a study: those of its profile; nobody tires who isn't simulated."""
    return tuple(n for n in study.profile.experiments if n != "tiring" or study.eeg == "simulated")


def count(study) -> tuple[int, int]:
    """Count the runs of a study's experiments that are done, and those that are missing.

    Before there are decoders, runs that cases share are counted for each.
    """
    try:
        beyond = Beyond(study)
    except FileNotFoundError:
        seeds, _ = seeds_and_sizes(study.profile)
        return 0, len(seeds) * sum(N_CASES[name] for name in planned(study))
    configs = {config for name in planned(study) for config in beyond.run_configs(name)}
    done = sum(is_done(config, beyond.runs) for config in configs)
    return done, len(configs) - done
