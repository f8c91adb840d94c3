"""What a study is: a profile (how much), an EEG source (whose brains) and a folder (where to)."""

from pathlib import Path

import numpy as np
import pandas as pd

from rlihf_lib.profiles import PROFILES
from rlihf_lib.rl.feedback import IDEAL, controls_of, p_error_sha256, with_controls
from rlihf_lib.rl.runs import RunConfig, SACSettings

REPOSITORY = Path(__file__).resolve().parents[1]
EEG_SOURCES = ("simulated", "hri")
EVENTS = ("correct", "error")
#: Conditions of the paper, and what stands beside them: settings and feedback of another kind.
STAGES = ("sparse", "tuned", "dense", "rlihf", "controls", "ablation")
#: What notebook 03 trains beside a condition.
SUPPLEMENTS = {"sparse": "tuned", "rlihf": "controls"}
#: Sparse reward with settings of its own: never giving up, and looking 5 s ahead. Found in pilots.
TUNED = {"patience": RunConfig.horizon, "sac": SACSettings(discount=0.98)}


class Study:
    """Names, sizes and folders of one study.

    Parameters
    ----------
    profile : {"smoke", "quick", "paper"}
        How much is computed.
    eeg : str or Path
        "simulated", "hri" (the paper's recordings), or a folder of epochs,
        `sub-XX[_ses-YY]_epo.fif`.
    out : str or Path
        Where `results/` and `figures/` go; empty for the repository.
    events : sequence of str
        Names of the correct and the error event in a folder of epochs.
    drop_channels : sequence of str
        Channels of a folder of epochs that are left out.

    Attributes
    ----------
    name : str
        Folder under `results/` and `figures/`, such as "quick-simulated".
    results, figures, decoder, runs, tables, notebooks : Path
        Where everything lies. Nothing is created before it is written to.

    Raises
    ------
    ValueError
        If the profile is unknown, `eeg` is neither a known source nor a folder, or `events` are
        not two names, or events or channels to drop are named for a known source.
    """

    def __init__(self, profile="quick", eeg="simulated", out="", events=EVENTS, drop_channels=()):
        if profile not in PROFILES:
            raise ValueError(f"profile is {profile!r}; choose one of {', '.join(PROFILES)}")
        self.profile = PROFILES[profile]
        self.eeg = str(eeg)
        if self.eeg in EEG_SOURCES:
            self.eeg_name = self.eeg
        else:
            folder = Path(self.eeg).expanduser()
            if not folder.is_dir():
                raise ValueError(
                    f"eeg is {self.eeg!r}, neither {' nor '.join(EEG_SOURCES)} nor a folder; "
                    "give one of these or a folder of sub-XX[_ses-YY]_epo.fif files"
                )
            self.eeg = str(folder.resolve())
            self.eeg_name = Path(self.eeg).name
            if self.eeg_name in EEG_SOURCES:
                raise ValueError(
                    f"the EEG folder {self.eeg} is named like a built-in source, "
                    "so their results would mix; rename the folder"
                )
        self.events = tuple(events)
        if len(set(self.events)) != 2:
            raise ValueError(f"events are {self.events}; give the names of two, correct and error")
        if self.eeg in EEG_SOURCES and self.events != EVENTS:
            raise ValueError(f"events can be named for a folder of epochs only, not for {self.eeg}")
        self.drop_channels = tuple(drop_channels)
        if self.eeg in EEG_SOURCES and self.drop_channels:
            raise ValueError(f"channels can be dropped from a folder only, not from {self.eeg}")
        self.name = f"{profile}-{self.eeg_name}"
        self.out = Path(out).expanduser().resolve() if str(out) else REPOSITORY
        self.results = self.out / "results" / self.name
        self.figures = self.out / "figures" / self.name
        self.decoder = self.results / "decoder"
        self.runs = self.results / "runs"
        self.tables = self.results / "tables"
        self.notebooks = self.results / "notebooks"

    @property
    def eeg_label(self):
        """Words for figures and tables: whose EEG this is."""
        return {
            "simulated": "simulated EEG",
            "hri": "recorded EEG (ErrP-HRI)",
        }.get(self.eeg_name, f"recorded EEG ({self.eeg_name})")

    def subjects(self):
        """Return the subjects to decode: the first `n_subjects` of the source, in its order."""
        from rlihf_lib.eeg.recordings import source_subjects  # imports MNE, so only when asked

        return source_subjects(self.eeg)[: self.profile.n_subjects]

    def p_error(self):
        """Read the p(error) table of held-out epochs, the only thing policies know of the EEG.

        Returns
        -------
        DataFrame
            Columns subject, epoch, label (1 = error), p_error in [0, 1] (calibrated), ...

        Raises
        ------
        FileNotFoundError
            If notebook 02 has not written it yet.
        ValueError
            If a column is missing or a probability is not in [0, 1].
        """
        path = self.decoder / "p_error.csv"
        table = _read_table(path, ("subject", "epoch", "label", "p_error"))
        if not table["p_error"].between(0, 1).all():
            row = table.index[~table["p_error"].between(0, 1)][0]
            raise ValueError(
                f"{path}, line {row + 2}: p_error is {table['p_error'][row]}, not in [0, 1]; "
                "write the table anew with notebook 02"
            )
        return table

    def scores(self):
        """Read the scores of the decoders, a row per held-out subject.

        Returns
        -------
        DataFrame
            Columns subject, auroc, ...

        Raises
        ------
        FileNotFoundError
            If notebook 02 has not written it yet.
        ValueError
            If one of the two columns is missing.
        """
        return _read_table(self.decoder / "scores.csv", ("subject", "auroc"))

    def policy_subjects(self, ablation=False):
        """Choose the subjects for whom policies are trained, before any policy is seen.

        The decoded subjects are sorted by the AUROC of their held-out epochs and
        `n_policy_subjects` are taken at equal distances of rank: with three, the weakest, the
        median and the strongest decoder; with one, the median.

        Parameters
        ----------
        ablation : bool
            Choose the `n_ablation_subjects` of the ablation instead.

        Returns
        -------
        list of str
            In the order of the table of scores.
        """
        ranked, profile = self.ranked_subjects(), self.profile
        wanted = profile.n_ablation_subjects if ablation else profile.n_policy_subjects
        count = min(wanted or len(ranked), len(ranked))
        ranks = np.linspace(0, len(ranked) - 1, count)
        chosen = {ranked[int(r)] for r in ranks} if count > 1 else {self.median_subject()}
        return [subject for subject in self.scores()["subject"] if subject in chosen]

    def ranked_subjects(self):
        """List the decoded subjects by the AUROC of their held-out epochs, weakest first."""
        return self.scores().sort_values(["auroc", "subject"])["subject"].tolist()

    def feedback(self):
        """Return all p(error) tables that a run may name: the people's, an ideal decoder's, and
        those of the person with the median decoder with what they say taken out; see
        `rl.feedback.with_controls`.
        """
        return with_controls(self.p_error(), self.median_subject())

    def feedback_of(self, subjects):
        """Return the fields of a `RunConfig` that name whose feedback it draws on.

        Parameters
        ----------
        subjects : iterable of str
            Of `feedback`.

        Returns
        -------
        dict of str to dict
            eeg, subject and p_error_sha256, by subject.
        """
        table = self.feedback()
        return {
            subject: {
                "eeg": self.eeg_name,
                "subject": subject,
                "p_error_sha256": p_error_sha256(table, subject),
            }
            for subject in subjects
        }

    def median_subject(self):
        """Return the person whose decoder is the median one, the lower of two."""
        ranked = self.ranked_subjects()
        return ranked[(len(ranked) - 1) // 2]

    def run_configs(self, stage):
        """List the runs of a stage.

        Parameters
        ----------
        stage : {"sparse", "tuned", "dense", "rlihf", "controls", "ablation"}
            A condition of the main comparison; sparse reward with settings of its own; the main
            weight with an ideal decoder and with feedback that says nothing; every weight of the
            ablation. The ablation's runs at the main weight are the main comparison's.

        Returns
        -------
        list of RunConfig

        Raises
        ------
        ValueError
            If the stage is unknown.
        FileNotFoundError
            If the stage needs p(error) and notebook 02 has not written it yet.
        """
        profile = self.profile
        if stage in ("sparse", "dense"):
            return [self._config(stage, seed) for seed in profile.seeds]
        if stage == "tuned":
            return [self._config("sparse", seed, **TUNED) for seed in profile.supplementary_seeds]
        if stage not in STAGES:
            raise ValueError(f"stage is {stage!r}; choose one of {', '.join(STAGES)}")
        weights, seeds = (profile.w_hf,), dict.fromkeys(self.policy_subjects(), profile.seeds)
        if stage == "ablation":
            weights = profile.weights
            seeds = dict.fromkeys(self.policy_subjects(ablation=True), profile.ablation_seeds)
        elif stage == "controls":
            nothing = dict.fromkeys(controls_of(self.median_subject()), profile.control_seeds)
            seeds = {IDEAL: profile.supplementary_seeds, **nothing}
        feedback = self.feedback_of(seeds)
        return [
            self._config("rlihf", seed, w_hf=w_hf, **feedback[subject])
            for w_hf in weights
            for subject in seeds
            for seed in seeds[subject]
        ]

    def _config(self, condition, seed, **changes):
        profile = self.profile
        changes = {
            "total_steps": profile.total_steps,
            "eval_every": profile.eval_every,
            "horizon": profile.horizon,
            "eval_rollouts": profile.eval_rollouts,
            **changes,
        }
        return RunConfig(condition=condition, seed=seed, **changes)


def _read_table(path, columns):
    if not path.is_file():
        raise FileNotFoundError(
            f"{path} does not exist yet; run notebook 02_loso_decoder first (--only 02)"
        )
    # Shortest-representation floats come back bit by bit only from the round-trip parser.
    table = pd.read_csv(path, dtype={"subject": str}, float_precision="round_trip")
    missing = [column for column in columns if column not in table.columns]
    if missing:
        raise ValueError(
            f"{path} lacks the column(s) {', '.join(missing)}; write it anew with notebook 02"
        )
    return table
