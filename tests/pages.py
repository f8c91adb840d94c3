"""What is computed in the pages of `PAGES`.

`python -m tests.pages` writes it anew, between `<!-- name -->` and `<!-- end -->`.
"""

import json
import re
from itertools import groupby

import pandas as pd

from rlihf_lib.files import write_text
from rlihf_lib.study import REPOSITORY, Study
from tests.benchmarks.__main__ import BENCHMARKS

PAGES = ("README.md", "results/README.md", "figures/README.md", "tests/benchmarks/README.md")
MEASURED = REPOSITORY / "tests" / "benchmarks" / "measured.json"
#: What each figure shows, in the order of the gallery; also the alternative text of the pictures.
CAPTIONS = {
    "fig2_overview": "From an error potential to a policy: EEG, decoder, reward, robot (Fig. 2)",
    "fig3_task": "The task: Kinova Gen2, red can, four obstacles, goal (Fig. 3)",
    "fig4_return_by_subject": "Evaluation return of sparse, dense and RLIHF for each person, and "
    "the mean over people (Fig. 4)",
    "fig5_decoder_accuracy": "Accuracy of each person's decoder, on validation people and on the "
    "held-out person (Fig. 5)",
    "fig6_whf": "Return and success for three weights of human feedback, and differences within "
    "people (Fig. 6)",
    "fig1_time_clearance": "Time and clearance of late successes, by weight; large marks: people "
    "who place the can at every weight (Fig. 1, as data)",
    "fig1_paths": "Paths round the obstacles, of the baselines and of each weight, from above and "
    "from the side (Fig. 1, as data)",
    "whf_inside": "What critics learn beside feedback: entropy coefficient and errors, in units of "
    "its weight",
    "eeg_trial_counts": "Correct and error epochs of each person",
    "eeg_waves": "Correct and error waves at Fz, Cz and Pz, and their difference, paired by person",
    "eeg_topographies": "Where on the head the difference shows, and when",
    "eeg_spectra": "Power spectra of one person, as recorded and preprocessed: median of the EEG "
    "channels",
    "decoder_scores": "AUROC and balanced accuracy of each held-out person, with chance levels",
    "decoder_reliability": "Is p(error) what it says? Reliability over all held-out epochs",
    "decoder_latency": "AUROC against when p(error) comes, filtered both ways and causally",
    "decoder_channels": "AUROC with EEG, EEG and EOG, and EOG alone",
    "decoder_patterns": "What one network's filters follow: spectra and patterns after Haufe",
    "online_update": "Adapting to the held-out person online: AUROC and accuracy by events seen",
    "training_sparse": "How sparse reward learns: training return by run, evaluation",
    "training_dense": "How dense reward learns: training return by run, evaluation",
    "training_rlihf": "How RLIHF learns: training return by run, evaluation",
    "learner_sparse": "Inside one learner, sparse reward: critics' loss, entropy coefficient, "
    "Q-values",
    "learner_dense": "Inside one learner, dense reward: critics' loss, entropy coefficient, "
    "Q-values",
    "learner_rlihf": "Inside one learner, RLIHF: the same, and the share of steps judged wrong",
    "film_sparse": "Film of a policy trained with sparse reward, what an observer thinks of each "
    "step, and what a decoder would have said",
    "film_dense": "Film of a policy trained with dense reward, with the same strips",
    "film_rlihf": "Film of a policy trained with human feedback, with the same strips",
    "film_compared": "Sparse, dense and RLIHF side by side in the same placement",
    "success_efficiency_deviation": "Success, path efficiency and path deviation during training",
    "comparison": "Performance profiles of late success, and probability that a run of RLIHF is "
    "better (ties count half)",
    "supplementary": "Late success of tuned sparse reward and of three controls of feedback, those "
    "with the median person's answers beside that person's own",
    "safety": "Collisions in late rollouts, and clearance of those that place the can",
    "paths": "Paths of trained policies round the obstacles, from above and from the side",
    "decoder_vs_policy": "What decides: what policies reach against the AUROC of the decoder; "
    "controls have it by construction",
    "equivalence": "As good as dense reward? Late success of each person and of all, less dense "
    "reward's, and the margins of equivalence",
    "people": "What people teach against AUROC: simulated EEG, recorded EEG that is replayed, "
    "yes/no decoders (whose AUROC is balanced accuracy); a rule judges the steps",
}


def results(study: Study) -> str:
    """Figures and tables of the paper beside ours, with the notebook that makes each."""
    late = _table(study, "late").pivot(index="group", columns="metric", values="mean")
    people = _table(study, "subjects").sort_values("auroc")
    scores = study.scores()
    weights = _table(study, "whf_phases").query("group == 'rlihf' and metric == 'success'")
    weights = weights.pivot(index="w_hf", columns="phase", values="mean")
    success, clearance, each = late["success"], 100 * late["clearance"], 100 * people["clearance"]
    compared = _table(study, "whf_comparison").query("metric == 'success' and p_holm < 0.05")
    larger = ", ".join(
        compared["comparison"].str.removeprefix("RLIHF ").str.replace(" - ", " over ")
    )
    n_people, n_seeds = len(people), len(study.profile.seeds)
    by_weight = ", ".join(f"{p.Mid:.2f} / {p.Late:.2f} with {w:g}" for w, p in weights.iterrows())
    fewer = study.profile.ablation_seeds
    told = f" (seed{'s' * (len(fewer) > 1)} {', '.join(map(str, fewer))})"
    seeds_of_weights = told if fewer != study.profile.seeds else ""
    accuracy, figures = scores["accuracy_online"], f"figures/{study.name}"
    rows = [
        (
            "Fig. 1",
            "keeps the distance people prefer",
            f"{clearance['rlihf']:.1f} cm from obstacles, {each.min():.1f} to {each.max():.1f} by "
            f"person (dense: {clearance['dense']:.1f})",
            f"{figures}/paths.png",
            "04",
        ),
        (
            "Fig. 3",
            "the task",
            "the same robot, can, obstacles and goal",
            f"{figures}/fig3_task.png",
            "03",
        ),
        (
            "Fig. 4",
            "sparse fails, RLIHF comes close to dense",
            f"late return {late['return']['sparse']:.0f} (sparse), {late['return']['dense']:.0f} "
            f"(dense), {late['return']['rlihf']:.0f} (RLIHF)",
            f"{figures}/fig4_return_by_subject.png",
            "04",
        ),
        (
            "Table I",
            "late success .00 (sparse), .54 (dense), .39 (RLIHF)",
            f"{success['sparse']:.2f}, {success['dense']:.2f}, {success['rlihf']:.2f}; from "
            f"{people['success'].min():.2f} to {people['success'].max():.2f} by person",
            f"results/{study.name}/tables/table1_phases.md",
            "04",
        ),
        (
            "Fig. 5",
            "decoders are right in 70 to 90 %",
            f"{accuracy.mean():.0%} of held-out epochs, {accuracy.min():.0%} to "
            f"{accuracy.max():.0%} by person",
            f"{figures}/fig5_decoder_accuracy.png",
            "02",
        ),
        (
            "Fig. 6",
            "weight 0.7 learns fastest",
            f"mid / late success {by_weight}{seeds_of_weights}; shown: {larger or 'nothing'}",
            f"{figures}/fig6_whf.png",
            "05",
        ),
    ]
    lines = [
        f"With {study.eeg_label}, {n_people} people x {n_seeds} seed{'s' * (n_seeds > 1)}, "
        f"{study.profile.total_steps:,} steps:",
        "",
        "| | paper | ours | notebook |",
        "|---|---|---|---|",
    ]
    for name, published, ours, where, number in rows:
        notebook = next((REPOSITORY / "notebooks").glob(f"{number}_*.ipynb")).name
        lines.append(
            f"| [{name}]({where}) | {published} | {ours} | [{number}](notebooks/{notebook}) |"
        )
    return "\n".join(lines)


def decoding(study: Study) -> str:
    """The EEG half in numbers beside the published ones, mean ± sample standard deviation."""
    scores, lda = study.scores(), pd.read_csv(study.tables / "lda.csv")
    against = _table(study, "decoder_against_published")
    against = against[against["subject"].isin(scores["subject"])]  # without mean, SD, ...
    wave = _table(study, "waves_against_published").set_index("measure")

    def spread(values, digits=2):
        return f"{values.mean():.{digits}f} ± {values.std():.{digits}f}"

    rows = [
        ("AUROC, leave-one-subject-out", spread(scores["auroc"]),
         spread(against["auroc_published"])),
        ("largest difference of a person's AUROC from the published",
         f"{(against['auroc'] - against['auroc_published']).abs().max():.3f}", ""),
        ("balanced accuracy", spread(scores["balanced_accuracy"]),
         spread(against["balanced_accuracy_published"])),
        ("calibration error, temperature-scaled (raw)",
         f"{scores['ece'].mean():.2f} ({scores['ece_raw'].mean():.2f})", ""),
        ("AUROC of shrinkage LDA, channels scaled (whitened)",
         f"{lda['auroc_lda'].mean():.3f} ({lda['auroc_whitened_lda'].mean():.3f})",
         "xDAWN + Riemann: .869"),
    ]  # fmt: skip
    rows += [(row.Index, f"{row.simulated:.3f}", f"{row.published:g}") for row in wave.itertuples()]
    return _markdown(("", study.eeg_label, "published"), rows)


def recorded(study: Study) -> str:
    """How well recorded people are decoded, mean ± sample standard deviation."""
    folder = REPOSITORY / "results/quick-ner2015"
    scores = pd.read_csv(folder / "decoder/scores.csv")
    lda = pd.read_csv(folder / "tables/lda.csv")
    rows = [
        (words, f"{values.mean():.3f} ± {values.std():.3f}")
        for words, values in (
            ("AUROC", scores["auroc"]),
            ("AUROC of shrinkage LDA, channels scaled", lda["auroc_lda"]),
            ("AUROC of shrinkage LDA, whitened", lda["auroc_whitened_lda"]),
            ("balanced accuracy", scores["balanced_accuracy"]),
            ("accuracy at p > 0.5", scores["accuracy_online"]),
            ("accuracy of saying always *correct*", scores["majority"]),
            ("calibration error", scores["ece"]),
        )
    ]
    return _markdown(("", f"NER 2015, {len(scores)} people"), rows)


def feedback(study: Study) -> str:
    """What human feedback adds to dense reward, and with whom it is worth following."""
    from rlihf_lib.rl.incentives import explained_sentence

    explained = _table(study, "explained_by_dense_rlihf").set_index("robot")
    margins = _table(study, "margins").query("observer == 'path'")
    told = " and ".join(
        f"{row.margin:.2f} [{row.low:.2f}, {row.high:.2f}] with {row.subject}"
        for row in margins.itertuples()
    )
    sentences = [explained_sentence(name, explained[name]) for name in explained]
    return " ".join(
        [
            *sentences,
            "The expert's expected discounted return exceeds that of the best robot that only "
            f"wants to look right by {told}, in standard deviations of a return's noise.",
        ]
    )


def pilots(study: Study) -> str:
    """Each group of pilots after the paper's number of steps."""
    return _late_by_person("pilots-simulated")


def smaller(study: Study) -> str:
    """Each group of the study of 60,000 steps."""
    return _late_by_person("quick-simulated")


def _late_by_person(name):
    """Means over the last third of training, of runs that are no longer shipped."""
    table = pd.read_csv(REPOSITORY / "results" / name / "tables/late_by_person.csv")
    table["clearance (cm)"] = table["clearance (cm)"].where(table["success"] > 0)  # of what moves
    rows = [
        (*row[:3], *("" if x == "" else f"{x:z.2f}" for x in row[3:]))
        for row in table.astype(object).where(table.notna(), "").itertuples(index=False)
    ]
    return _markdown(table.columns, rows)


def speed(study: Study) -> str:
    """How much faster than the stock stack, in a sentence."""
    ratios = json.loads(MEASURED.read_text(encoding="utf-8"))
    return (
        f"[Speed](tests/benchmarks/README.md), on {ratios['machine']}: the environment is "
        f"{ratios['env_speedup']:.1f} times as fast as robosuite's own, training "
        f"{ratios['train_speedup']:.1f} times as fast as Stable-Baselines3's SAC on it."
    )


def benchmarks(study: Study) -> str:
    """Every ratio measured, and what is wanted."""
    ratios = json.loads(MEASURED.read_text(encoding="utf-8"))
    rows = []
    for name, (what, wanted) in BENCHMARKS.items():
        value = ratios[name]
        shown = (
            value if isinstance(value, str) else f"{value:.2f}" if value < 20 else f"{value:.0f}"
        )
        rows.append((f"`{name}`", what, shown, wanted))
    return _markdown(("", "what", ratios["machine"], "wanted"), rows)


def gallery(study: Study) -> str:
    """Every shipped figure of every study: what it shows, its notebook and its sources."""
    lines = []
    for manifest in sorted(
        (REPOSITORY / "figures").glob("[!sc]*/manifest.json")
    ):  # no smoke, no class
        entries = json.loads(manifest.read_text(encoding="utf-8"))
        folder = manifest.parent.name
        lines += [f"## {folder}", ""]
        for name, words in CAPTIONS.items():
            if name not in entries:
                continue
            entry = entries[name]
            suffix = "gif" if name.startswith("film") else "png"
            lines += [
                f"![{words}]({folder}/{name}.{suffix})",
                "",
                f"**{words}.** {_notebook(folder, name, entry['notebook'])}; "
                f"{_sources(entry['sources'])}.",
                "",
            ]
    return "\n".join(lines).rstrip()


def _notebook(study, figure, notebook):
    """Links to a notebook and, where one is shipped, to the executed copy that shows a figure."""
    links, copies = f"[`{notebook}`](../notebooks/{notebook}.ipynb)", f"results/{study}/notebooks"
    for title in (f"{notebook}-{figure.split('_')[-1]}", f"{notebook}-rlihf", notebook):
        if (REPOSITORY / copies / f"{title}.ipynb").is_file():
            return f"{links} ([executed](../{copies}/{title}.ipynb))"
    return links


def _sources(sources):
    """Say in short what a figure was drawn from."""
    if not sources:
        return "drawn from the model of the task"
    folders = sorted({name.rpartition("/")[0] if "/runs/" in name else name for name in sources})
    told = []
    for is_run, names in groupby(folders, key=lambda name: "/runs/" in name):
        names = list(names)
        told.append(
            f"{len(names)} run{'s' * (len(names) > 1)}"
            if is_run
            else ", ".join(f"`{name}`" for name in names)
        )
    return "drawn from " + ", ".join(told)


def _table(study, name):
    return pd.read_csv(study.tables / f"{name}.csv", keep_default_na=False, na_values=[""])


def _markdown(header, rows):
    lines = [header, ["---"] * len(header), *rows]
    return "\n".join("| " + " | ".join(str(cell) for cell in line) + " |" for line in lines)


PARTS = {
    part.__name__: part
    for part in (results, decoding, recorded, feedback, pilots, smaller, speed, benchmarks, gallery)
}


def filled(text: str, study: Study) -> str:
    """Return a page with its computed parts written anew.

    Raises
    ------
    KeyError
        If a part is unknown.
    """
    return re.sub(
        r"(<!-- (\w+) -->\n).*?(<!-- end -->)",
        lambda match: f"{match[1]}{PARTS[match[2]](study)}\n{match[3]}",
        text,
        flags=re.DOTALL,
    )


if __name__ == "__main__":
    for page in PAGES:
        path = REPOSITORY / page
        write_text(path, filled(path.read_text(encoding="utf-8"), Study()))
