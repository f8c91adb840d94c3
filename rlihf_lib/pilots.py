"""Pilots: the final settings on seeds that no study uses. `python -m rlihf_lib pilots`.

The paper's 150,000 steps of dense and sparse reward, the latter also with settings of its own; of
feedback from an ideal decoder (p = label), also with the lay observer, and from the weakest, the
median and the strongest decoded subject. Task, rewards, observer and learner were chosen on earlier
ones before any study was computed; they are the same for all conditions.
"""

import argparse

import matplotlib.pyplot as plt

from rlihf_lib.files import write_csv
from rlihf_lib.regenerate import worker_count
from rlihf_lib.report.evaluations import add_phase, read_runs
from rlihf_lib.report.figures_policy import learning_curve, mark_phases
from rlihf_lib.report.saving import save_figure
from rlihf_lib.report.style import PAGE_WIDTH, color, label, shades, use_style
from rlihf_lib.rl.config import RunConfig, SACSettings
from rlihf_lib.rl.sweep import is_done, run_sweep
from rlihf_lib.study import Study

SEEDS = (100, 101, 102)
STEPS, EVAL_EVERY = 150_000, 10_000
# The learner's horizon of 1 s and giving up after 2 s help feedback; "sparse, tuned" does without
# the latter and looks 5 or 10 s ahead.
SPARSE_DISCOUNTS = (0.98, 0.99)
TUNED_GROUPS = tuple(f"sparse-patience1000-discount{d:g}" for d in SPARSE_DISCOUNTS)
IDEAL = "ideal"
COLUMNS = ("success", "completed", "path_efficiency", "path_deviation", "collisions")


def run_configs(study):
    """List the pilots, those first whose answer is needed first.

    Parameters
    ----------
    study : Study
        Its policy subjects are the decoders tried.

    Returns
    -------
    list of RunConfig
    """
    weakest, *_, strongest = study.ranked_subjects()
    median = study.median_subject()
    feedback = study.feedback_of((IDEAL, weakest, median, strongest))

    def config(seed, condition, subject="", **changes):
        if subject:
            changes = {"w_hf": study.profile.w_hf, **feedback[subject], **changes}
        return RunConfig(condition, seed, STEPS, EVAL_EVERY, **changes)

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
    ]


def summary(runs):
    """Average each run over the last third of training: a row per run."""
    late = add_phase(runs).query("phase == 'Late'")
    keys = ["group", "subject", "run"]
    return late.groupby(keys)[list(COLUMNS)].mean().round(3).reset_index()


def learning_curves(runs, scores):
    """Draw success rate and completed share of the path: a line per group and subject.

    Parameters
    ----------
    runs : DataFrame
        From `report.evaluations.read_runs`.
    scores : DataFrame
        From `Study.scores`; the AUROC of a subject's decoder is told and gives the shade.

    Returns
    -------
    matplotlib Figure
        Above the paper's conditions, below what stands beside them: the lay observer, and sparse
        reward with settings of its own.
    """
    decoded = scores[scores["subject"].isin(runs["subject"])].sort_values("auroc", ascending=False)
    people = {"": ("", None), IDEAL: ("ideal decoder", color("rlihf-ideal"))}
    for row, shade in zip(decoded.itertuples(), shades(len(decoded))[::-1], strict=True):
        people[row.subject] = (f"{row.subject}, AUROC {row.auroc:.2f}", shade)
    rows = (
        ("as in the paper", ("dense", "rlihf-ideal", "rlihf", "sparse")),
        ("supplementary", ("rlihf-ideal-lay", *TUNED_GROUPS)),
    )
    metrics = {"success": "Success rate", "completed": "Share of the path completed"}
    fig, axes = plt.subplots(2, 2, figsize=(PAGE_WIDTH, 4.2), sharex=True, sharey="col")
    places = ("outside right upper", "outside right lower")
    for (title, groups), panels, place in zip(rows, axes, places, strict=True):
        for ax, (metric, axis_label) in zip(panels, metrics.items(), strict=True):
            for group in groups:
                for subject, (name, shade) in people.items():
                    chosen = runs[(runs["group"] == group) & (runs["subject"] == subject)]
                    if len(chosen):
                        known = group if subject == "" else "rlihf" + "-lay" * ("lay" in group)
                        parts = (label(known), name, f"n = {chosen['run'].nunique()}")
                        words = ", ".join(part for part in parts if part)
                        look = color(group) if shade is None else shade
                        learning_curve(chosen, ax, metric, color=look, label=words)
            mark_phases(ax, STEPS)
            ax.set(xlabel="", ylabel=axis_label, ylim=(-0.03, 1.03), title=title)
        fig.legend(*panels[0].get_legend_handles_labels(), loc=place, title=title)
    for ax in axes[-1]:
        ax.set_xlabel("Steps (thousands)")
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
    configs = run_configs(study)
    try:
        run_sweep(configs, study.runs, study.feedback(), options.workers)
    except KeyboardInterrupt:
        print("interrupted; the same command goes on from here")
    done = [config for config in configs if is_done(config, study.runs)]
    runs = read_runs(done, study.runs)
    write_csv(study.results / "summary.csv", summary(runs))
    use_style()
    says = (
        f"pilots, seeds {SEEDS[0]} to {SEEDS[-1]} · w = {study.profile.w_hf} · "
        "mean, and thin each run"
    )
    fig, sources = learning_curves(runs, study.scores()), [config.run_id for config in done]
    save_figure(fig, study, "learning_curves", "pilots", sources, says)
    return 0
