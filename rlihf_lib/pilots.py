"""Pilots: the runs behind the settings, on seeds that no study uses. `python -m rlihf_lib pilots`.

The paper's 150,000 steps of dense and sparse reward, of feedback from an ideal decoder (p = label)
and of feedback from the weakest, the median and the strongest decoded subject. Task, rewards,
observer and learner were chosen on such runs before any study was computed; they are the same for
all conditions.
"""

import argparse

import matplotlib.pyplot as plt
import pandas as pd

from rlihf_lib.files import write_csv
from rlihf_lib.regenerate import worker_count
from rlihf_lib.report.evaluations import add_phase, read_runs
from rlihf_lib.report.figures_policy import DASHES, learning_curve, mark_phases
from rlihf_lib.report.style import COLORS, PAGE_WIDTH, note, save_figure, use_style
from rlihf_lib.rl.config import RunConfig, SACSettings
from rlihf_lib.rl.observer import p_error_sha256, perfect_table
from rlihf_lib.rl.sweep import is_done, run_sweep
from rlihf_lib.study import Study

SEEDS = (100, 101, 102)
STEPS, EVAL_EVERY = 150_000, 10_000
# The learner's horizon of 1 s and giving up after 2 s help feedback; "sparse, tuned" does without
# the latter and looks 5 or 10 s ahead.
SPARSE_DISCOUNTS = (0.98, 0.99)
IDEAL = "ideal"
COLUMNS = ("success", "completed", "path_efficiency", "path_deviation", "collisions")


def tables(study):
    """Return the p(error) table of the decoded subjects and of an ideal decoder."""
    return pd.concat([study.p_error(), perfect_table().assign(subject=IDEAL)], ignore_index=True)


def run_configs(study, p_error):
    """List the pilots, those first whose answer is needed first.

    Parameters
    ----------
    study : Study
        Its policy subjects are the decoders tried.
    p_error : DataFrame
        From `tables`.

    Returns
    -------
    list of RunConfig
    """

    def config(seed, condition, subject="", **changes):
        if subject:
            digest = p_error_sha256(p_error, subject)
            feedback = {"subject": subject, "eeg": study.eeg_name, "p_error_sha256": digest}
            changes = {"w_hf": study.profile.w_hf, **feedback, **changes}
        return RunConfig(condition, seed, STEPS, EVAL_EVERY, **changes)

    weakest, *_, strongest = ranked = study.ranked_subjects()
    median = ranked[(len(ranked) - 1) // 2]
    return [
        *(config(seed, "dense") for seed in SEEDS),
        *(config(seed, "rlihf", IDEAL) for seed in SEEDS),
        config(SEEDS[0], "sparse"),
        *(
            config(seed, "sparse", patience=RunConfig.horizon, sac=SACSettings(discount=discount))
            for seed in SEEDS[:2]
            for discount in SPARSE_DISCOUNTS
        ),
        *(config(seed, "rlihf", who) for seed in SEEDS[:2] for who in (strongest, median)),
        config(SEEDS[0], "rlihf", IDEAL, observer="lay"),
        config(SEEDS[0], "rlihf", weakest),
        *(
            config(seed, "rlihf", who, observer="lay")
            for seed in SEEDS[:1]
            for who in (strongest, median)
        ),
    ]


def summary(runs):
    """Average each run over the last third of training: a row per run."""
    late = add_phase(runs, STEPS).query("phase == 'Late'")
    keys = ["condition", "subject", "w_hf", "run"]
    return late.groupby(keys)[list(COLUMNS)].mean().round(3).reset_index()


def learning_curves(runs, w_hf, scores, caption):
    """Draw success rate and completed share of the path: a line per condition or subject.

    Parameters
    ----------
    runs : DataFrame
        From `report.evaluations.read_runs`.
    w_hf : float
        Weight of human feedback shown.
    scores : DataFrame
        From `Study.scores`; the AUROC of a subject's decoder is told and gives the shade.
    caption : str

    Returns
    -------
    matplotlib Figure
    """
    runs = runs[(runs["condition"] != "rlihf") | (runs["w_hf"] == w_hf)]
    decoded = scores[scores["subject"].isin(runs["subject"])].sort_values("auroc", ascending=False)
    lines = {
        ("dense", ""): {"color": COLORS["dense"], "label": "RL dense"},
        ("rlihf", IDEAL): {"color": COLORS["ideal"], "label": "RLIHF, ideal decoder"},
    }
    for i, (subject, auroc) in enumerate(zip(decoded["subject"], decoded["auroc"], strict=True)):
        lines["rlihf", subject] = {
            "color": plt.get_cmap("YlOrRd")(0.9 - 0.5 * i / len(decoded)),
            "label": f"RLIHF, {subject}, AUROC {auroc:.2f}",
        }
    lines["sparse", ""] = {"color": COLORS["sparse"], "label": "RL sparse"}
    fig, axes = plt.subplots(1, 2, figsize=(PAGE_WIDTH, 2.4), sharex=True)
    for ax, metric, label in zip(
        axes, ("success", "completed"), ("Success rate", "Share of the path completed"), strict=True
    ):
        for (condition, subject), line in lines.items():
            chosen = runs[(runs["condition"] == condition) & (runs["subject"] == subject)]
            if len(chosen):
                name = f"{line['label']} (n = {chosen['run'].nunique()})"
                style = {**line, "label": name, "linestyle": DASHES[condition]}
                learning_curve(chosen, ax, metric, **style)
        mark_phases(ax, STEPS)
        ax.set(xlabel="Steps (thousands)", ylabel=label, ylim=(-0.03, 1.03))
    fig.legend(*axes[0].get_legend_handles_labels(), loc="outside right center")
    note(fig, caption)
    return fig


def main(argv=None):
    """Train the pilots that are missing, then write table and figure; return the exit status."""
    command = argparse.ArgumentParser(prog="python -m rlihf_lib pilots", description=__doc__)
    command.add_argument(
        "--workers", type=worker_count, default=0, help="processes (default: the cores)"
    )
    options = command.parse_args(argv)
    study = Study("quick")
    study.results = study.out / "results" / "pilots"
    study.runs, study.figures = study.results / "runs", study.out / "figures" / "pilots"
    p_error = tables(study)
    configs = run_configs(study, p_error)
    try:
        run_sweep(configs, study.runs, p_error, options.workers)
    except KeyboardInterrupt:
        print("interrupted; the same command goes on from here")
    done = [config for config in configs if is_done(config, study.runs)]
    runs = read_runs(done, study.runs)
    write_csv(study.results / "summary.csv", summary(runs))
    use_style()
    caption = (
        f"pilots, seeds {SEEDS[0]} to {SEEDS[-1]} · {study.eeg_label} · w = {study.profile.w_hf} · "
        "mean and 95 % bootstrap interval over runs"
    )
    fig = learning_curves(runs, study.profile.w_hf, study.scores(), caption)
    save_figure(fig, study, "learning_curves", "pilots", [config.run_id for config in done])
    return 0
