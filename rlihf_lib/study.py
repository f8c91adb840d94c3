"""What a study is: a profile (how much), an EEG source (whose brains) and a folder (where to)."""

import json
from pathlib import Path

import numpy as np
import pandas as pd

from rlihf_lib.files import check_sums
from rlihf_lib.paths import EEG_SOURCES, eeg_folder, output_folder, p_error_table
from rlihf_lib.profiles import PROFILES
from rlihf_lib.rl.feedback import (
    COLUMNS,
    IDEAL,
    NOT_DECODED,
    adopt_table,
    controls_of,
    p_error_sha256,
    read_table,
    with_controls,
)
from rlihf_lib.rl.runs import RunConfig, SACSettings, is_done, is_whole

REPOSITORY = Path(__file__).resolve().parents[1]
EVENTS = ("correct", "error")
#: Conditions of the paper, and what stands beside them: settings and feedback of another kind.
STAGES = ("sparse", "tuned", "dense", "rlihf", "controls", "ablation")
#: What notebook 03 trains beside a condition.
SUPPLEMENTS = {"sparse": "tuned", "rlihf": "controls"}

SECONDS_PER_STEP = 0.007  # of one core; a study's own finished runs are used once there are any
SECONDS_PER_FOLD = 40
N_PEOPLE = 12  # of both built-in sources


class Study:
    """Names, sizes and folders of one study; nothing is created before it is written to.

    Parameters
    ----------
    profile : {"smoke", "class", "quick", "paper", "pilots"}
        How much is computed.
    eeg : str or Path
        "simulated", "hri" (the paper's recordings), a folder of one's own (`eeg.folders`), or what
        somebody else's decoder says: a table of p(error), FILE.csv (`rl.feedback.read_table`).
    out : str or Path
        Where `results/` and `figures/` go; empty for the repository.
    events, drop_channels : sequence of str
        Of a folder the names of the correct and the error event, and channels left out.
    ship : bool
        Whether figures and tables of the repository are replaced; else a reader's go to the folder
        `yours` beside the runs, which git ignores.

    Raises
    ------
    ValueError
        If profile or `eeg` are unknown, a folder holds no recordings (`eeg.folders.find`), `events`
        are not two names, events or channels to drop are named for a built-in source, or `out`
        cannot be a folder.
    """

    def __init__(
        self, profile="paper", eeg="simulated", out="", events=EVENTS, drop_channels=(), ship=True
    ):
        if profile not in PROFILES:
            raise ValueError(f"profile is {profile!r}; choose one of {', '.join(PROFILES)}")
        self.profile = PROFILES[profile]
        self.eeg = self.eeg_name = str(eeg)
        self.events, self.drop_channels = tuple(events), tuple(drop_channels)
        if len(self.events) != 2 or len({*map(str.strip, self.events)} - {""}) != 2:
            raise ValueError(f"events are {self.events}; give the names of two, correct and error")
        self.is_table = self.eeg.endswith(".csv")
        self.is_folder = not self.is_table and self.eeg not in EEG_SOURCES
        if self.is_table or self.is_folder:
            self.eeg, self.eeg_name = (p_error_table if self.is_table else eeg_folder)(self.eeg)
        if not self.is_folder:
            if self.events != EVENTS:
                raise ValueError(f"events can be named for a folder only, not for {self.eeg}")
            if self.drop_channels:
                raise ValueError(f"channels can be dropped from a folder only, not from {self.eeg}")
        self.name = f"{profile}-{self.eeg_name}"
        self.out = output_folder(out) if str(out) else REPOSITORY
        self.results = self.out / "results" / self.name
        self.decoder = self.results / "decoder"
        self.runs = self.results / "runs"
        self.shipped_figures = self.out / "figures" / self.name
        self.shipped_tables = self.results / "tables"
        self.figures, self.tables = self.shipped_figures, self.shipped_tables
        if not ship and self.out == REPOSITORY:
            self.figures, self.tables = (self.results / "yours" / n for n in ("figures", "tables"))
        self.notebooks = self.results / "notebooks"
        # What `vary` sets: whose feedback trains all policies, and fields of their configs.
        self.subject, self.changes = "", {}

    @property
    def eeg_label(self) -> str:
        """Words for figures and tables: whose EEG this is."""
        if self.is_table:
            return f"p(error) of {self.eeg_name}"
        recorded = {"simulated": "simulated EEG", "hri": "recorded EEG (ErrP-HRI)"}
        return recorded.get(self.eeg_name, f"recorded EEG ({self.eeg_name})")

    def find_table(self, name: str) -> Path:
        """Path of a table that another notebook has written: by this reader, else as shipped."""
        path = self.tables / name
        return path if path.is_file() else self.shipped_tables / name

    def subjects(self) -> list[str]:
        """Return the subjects to decode: the first `n_subjects` of the source, in its order."""
        from rlihf_lib.eeg.recordings import source_subjects  # imports MNE, so only when asked

        return source_subjects(self.eeg)[: self.profile.n_subjects]

    def p_error(self) -> pd.DataFrame:
        """Read the p(error) table of held-out epochs, the only thing policies know of the EEG.

        As `rl.feedback.read_table`, whose errors it has. Somebody else's is adopted first.
        """
        return self._read_decoded("p_error.csv", COLUMNS)

    def scores(self) -> pd.DataFrame:
        """Read the scores of the decoders, a row per held-out subject; errors as in `p_error`."""
        return self._read_decoded("scores.csv", ("subject", "auroc"))

    def _read_decoded(self, name, columns):
        if self.is_table:
            adopt_table(Path(self.eeg), self.decoder)
        path = self.decoder / name
        # Sums come last: without them, one table may be of these people and another of others.
        if not check_sums(self.decoder):
            raise FileNotFoundError(f"{path} does not exist yet; {NOT_DECODED}")
        return read_table(path, columns)

    def ranked_subjects(self) -> list[str]:
        """List the decoded subjects by the AUROC of their held-out epochs, weakest first."""
        return self.scores().sort_values(["auroc", "subject"])["subject"].tolist()

    def median_subject(self) -> str:
        """Return the person whose decoder is the median one, the lower of two."""
        ranked = self.ranked_subjects()
        return ranked[(len(ranked) - 1) // 2]

    def policy_subjects(self, ablation=False) -> list[str]:
        """Choose the subjects for whom policies are trained, before any policy is seen.

        Of the decoded subjects, sorted by the AUROC of their held-out epochs, `n_policy_subjects`
        (for the ablation `n_ablation_subjects`) at equal distances of rank: with three, the
        weakest, the median and the strongest decoder; with one, the profile's `rank`. In the order
        of the table of scores.
        """
        if self.subject:
            return [self.subject]
        ranked, profile = self.ranked_subjects(), self.profile
        wanted = profile.n_ablation_subjects if ablation else profile.n_policy_subjects
        count = min(wanted or len(ranked), len(ranked))
        last = len(ranked) - 1
        ranks = np.linspace(0, last, count) if count > 1 else [profile.rank * last]
        chosen = {ranked[int(rank)] for rank in ranks}
        return [subject for subject in self.scores()["subject"] if subject in chosen]

    def feedback(self) -> pd.DataFrame:
        """Return the people's p(error), and the controls of the person with the median decoder."""
        return with_controls(self.p_error(), self.median_subject())

    def run_configs(self, stage) -> list[RunConfig]:
        """List the runs of one of `STAGES`.

        A condition of the main comparison ("sparse", "dense", "rlihf"); sparse reward with settings
        of its own ("tuned"); the main weight with an ideal decoder and with feedback that says
        nothing ("controls"); every weight ("ablation"; its runs at the main weight are the main
        comparison's). A FileNotFoundError says if p(error) is needed and not written yet.
        """
        profile = self.profile
        if stage in ("sparse", "dense"):
            return [self._config(stage, seed) for seed in profile.seeds]
        if stage == "tuned":
            # Never giving up, and looking further ahead.
            return [
                self._config("sparse", seed, patience=RunConfig.horizon, sac=settings)
                for settings in [SACSettings(discount=d) for d in profile.tuned_discounts]
                for seed in profile.tuned_seeds
            ]
        if stage not in STAGES:
            raise ValueError(f"stage is {stage!r}; choose one of {', '.join(STAGES)}")
        weights = profile.weights if stage == "ablation" else (profile.w_hf,)
        seeds = dict.fromkeys(self.policy_subjects(), profile.seeds)
        if stage == "ablation":
            seeds = dict.fromkeys(self.policy_subjects(ablation=True), profile.ablation_seeds)
        elif stage == "controls":
            nothing = dict.fromkeys(controls_of(self.median_subject()), profile.control_seeds)
            seeds = {IDEAL: profile.ideal_seeds, **nothing}
        table = self.feedback()
        sources = {
            subject: {
                "eeg": self.eeg_name,
                "subject": subject,
                "p_error_sha256": p_error_sha256(table, subject),
            }
            for subject in seeds
        }
        return [
            self._config("rlihf", seed, w_hf=w_hf, **sources[subject])
            for w_hf in weights
            for subject in seeds
            for seed in seeds[subject]
        ]

    def _config(self, condition, seed, **changes):
        sizes = {
            name: getattr(self.profile, name)
            for name in ("total_steps", "eval_every", "horizon", "eval_rollouts")
        }
        return RunConfig(condition=condition, seed=seed, **sizes | self.changes | changes)

    def status(self, workers=0) -> pd.DataFrame:
        """Count what is done and missing of each long stage, and the seconds of the rest.

        On `workers` processes, 0 = one per core. Folds are counted of notebook 02, else runs.
        """
        from rlihf_lib import beyond  # read studies
        from rlihf_lib.rl.sweep import CPU_COUNT  # imports Dask, so only when asked

        per_step, workers = self._seconds_per_step(), workers or CPU_COUNT

        def seconds(n_runs, sizes):
            return n_runs * sizes["total_steps"] * per_step / max(1, min(workers, n_runs))

        folds = len(list((self.decoder / "folds").glob("*/")))
        n_people = N_PEOPLE
        if self.is_table or check_sums(self.decoder):
            folds, missing = self.p_error()["subject"].nunique(), 0
        else:
            n_people = len(self.subjects()) if self.is_folder else N_PEOPLE
            missing = max(min(self.profile.n_subjects or n_people, n_people) - folds, 1)
        rows = [("02_loso_decoder", folds, missing, missing * SECONDS_PER_FOLD)]
        counted: set[RunConfig] = set()
        for stage in STAGES:
            title = "05_whf_ablation" if stage == "ablation" else f"03_policy_training {stage}"
            try:
                configs = self.run_configs(stage)
            except FileNotFoundError:  # the decoder says later who the policy subjects are
                done, missing = 0, self.profile.n_runs(stage, n_people)
                new = missing
                if stage == "ablation":  # those at the main weight are counted already
                    new -= missing // len(self.profile.weights)
            else:
                left = [config for config in configs if not is_done(config, self.runs)]
                done, missing, new = len(configs) - len(left), len(left), len({*left} - counted)
                counted.update(left)
            rows.append((title, done, missing, seconds(new, vars(self.profile))))
        if self.profile.experiments:
            done, missing = beyond.count(self)
            _, sizes = beyond.seeds_and_sizes(self.profile)
            rows.append(("06_beyond_the_paper", done, missing, seconds(missing, sizes)))
        return pd.DataFrame(rows, columns=["stage", "done", "missing", "seconds"])

    def _seconds_per_step(self):
        """Mean over the study's finished runs; a default before there are any."""
        seconds, steps = 0.0, 0
        for folder in filter(is_whole, self.runs.glob("*/")):
            provenance, config = (
                json.loads((folder / f"{name}.json").read_text(encoding="utf-8"))
                for name in ("provenance", "config")
            )
            seconds += provenance["wall_seconds"]
            steps += config["total_steps"]
        return seconds / steps if steps else SECONDS_PER_STEP
