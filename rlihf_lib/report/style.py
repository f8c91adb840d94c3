"""How figures and tables look, where they are saved, and what each figure was drawn from."""

import json
import textwrap
from pathlib import Path

import matplotlib as mpl
import numpy as np
import pandas as pd

from rlihf_lib.files import atomic_path, sha256, write_csv, write_text
from rlihf_lib.task.rendering import film

# Okabe & Ito (2008), "Color Universal Design": told apart with every common colour blindness.
COLORS = {
    "sparse": "#7F7F7F",
    "dense": "#0072B2",
    "rlihf": "#D55E00",
    "correct": "#0072B2",
    "error": "#D55E00",
    "pretrain": "#F0E442",  # the paper's Fig. 5: yellow and orange bars
    "online": "#E69F00",
    "rlihf-ideal": "#000000",
    "rlihf-mean": "#CC79A7",
    "rlihf-shuffled": "#E69F00",
    "rlihf-lay": "#882255",
    "sparse-patience1000-discount0.98": "#009E73",
    "sparse-patience1000-discount0.99": "#56B4E9",
}
#: Every name under which runs are compared (`evaluations.group_of`), as people read it.
LABELS = {
    "sparse": "RL sparse",
    "dense": "RL dense",
    "rlihf": "RLIHF",
    "sparse-patience1000-discount0.98": "RL sparse, tuned (0.98)",
    "sparse-patience1000-discount0.99": "RL sparse, tuned (0.99)",
    "rlihf-ideal": "RLIHF, ideal p",
    "rlihf-mean": "RLIHF, constant p",
    "rlihf-shuffled": "RLIHF, shuffled p",
    "rlihf-lay": "RLIHF, lay observer",
}

# Inches of a two-column conference page (ieeeconf, letter).
COLUMN_WIDTH = 3.4
PAGE_WIDTH = 7.0

FILM_STEPS = 80  # control steps of a film, 0.1 s each

RC = {
    "figure.dpi": 120,
    "savefig.dpi": 200,
    "savefig.bbox": "tight",
    "savefig.pad_inches": 0.03,
    "figure.constrained_layout.use": True,
    "font.size": 8,
    "axes.titlesize": 8,
    "axes.labelsize": 8,
    "xtick.labelsize": 7,
    "ytick.labelsize": 7,
    "legend.fontsize": 7,
    "legend.frameon": False,
    "lines.linewidth": 1.2,
    "axes.linewidth": 0.6,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.grid": True,
    "axes.axisbelow": True,
    "grid.color": "#E5E5E5",
    "grid.linewidth": 0.5,
    "pdf.fonttype": 42,  # journals refuse Type 3 fonts
}


def label(group):
    """Return how people read a group's name; the name itself where there is no other."""
    return LABELS.get(group, group)


def color(group):
    """Return a group's colour, the same in every figure; dark grey where it has none."""
    return COLORS.get(group, "#444444")


def ordered(groups):
    """Sort groups for tables and figures: as in `LABELS`, the paper's first, unknown ones last."""
    known = list(LABELS)
    return sorted(set(groups), key=lambda g: (known.index(g) if g in known else len(known), g))


def shades(n):
    """Return `n` colours, light to dark: told apart in every colour vision and in grey."""
    return list(mpl.colormaps["inferno"](np.linspace(0.75, 0.2, n)))


LATEX = str.maketrans(
    {"%": r"\%", "_": r"\_", "&": r"\&", "#": r"\#", "<": "$<$", ">": "$>$", "·": r"$\cdot$"}
)


def use_style():
    """Set Matplotlib's defaults for a two-column paper."""
    mpl.rcParams.update(RC)


def caption(study, n=""):
    """Return what every figure must own up to: whose EEG, which profile, how many of what.

    Parameters
    ----------
    study : Study
    n : str
        Such as "3 subjects x 2 seeds".
    """
    return " · ".join(filter(None, [study.eeg_label, f"profile {study.profile.name}", n]))


def note(fig, text):
    """Write `text` small and grey under a figure, in lines of its width."""
    lines = textwrap.fill(text, int(23 * fig.get_figwidth()))
    fig.supxlabel(lines, fontsize=6, color="#555555")


def save_figure(fig, study, name, notebook, sources=()):
    """Save a figure as PDF and PNG and record in `manifest.json` what it was drawn from.

    Parameters
    ----------
    fig : matplotlib.figure.Figure
    study : Study
        Gives the folder, `figures/<study>/`.
    name : str
        File name without suffix, such as "fig5_decoder_accuracy".
    notebook : str
        The notebook that draws it, such as "02_loso_decoder".
    sources : sequence of (Path or str)
        Files, or ids of runs of the study (their `eval.csv`), whose data are in the figure.

    Returns
    -------
    Path
        The PNG.

    Raises
    ------
    FileNotFoundError
        If a source does not exist: a figure from nowhere is not saved.
    """
    hashes = _hashes(name, study, sources)
    # Without a fixed date and software version, equal data would give unequal files.
    metadata = {".pdf": {"CreationDate": None}, ".png": {"Software": None}}
    for suffix, fields in metadata.items():
        with atomic_path(study.figures / f"{name}{suffix}") as temporary:
            fig.savefig(temporary, metadata=fields)
    _enter(study, name, notebook, hashes)
    return study.figures / f"{name}.png"


def save_film(recording, study, name, notebook, sources):
    """Save a film of a rollout as GIF and record its sources; arguments as in `save_figure`.

    Rendering takes half a minute without a graphics card, so a film of the same sources is kept.

    Parameters
    ----------
    recording : rlihf_lib.rl.evaluation.Recording

    Returns
    -------
    Path or None
        The GIF; None where no OpenGL library can render it.
    """
    hashes = _hashes(name, study, sources)
    path = study.figures / f"{name}.gif"
    if path.is_file() and _manifest(study).get(name, {}).get("sources") == hashes:
        return path
    if not film(path, recording.qpos[:FILM_STEPS], recording.seed):
        return None
    _enter(study, name, notebook, hashes)
    return path


def save_table(study, name, table, shown=None, says=""):
    """Write a table as `tables/<name>.csv` and, as people read it, as Markdown and as LaTeX.

    Parameters
    ----------
    study : Study
    name : str
    table : DataFrame
        All numbers, in full precision.
    shown : DataFrame, optional
        What Markdown and LaTeX show; `table` if None. Where its index changes, a line is drawn.
    says : str
        What the numbers are, after what every caption says.

    Returns
    -------
    DataFrame
        What was shown.
    """
    shown = table if shown is None else shown
    write_csv(study.tables / f"{name}.csv", table)
    texts = typeset(shown, " · ".join(filter(None, [caption(study), says])))
    for suffix, text in texts.items():
        write_text(study.tables / f"{name}{suffix}", text)
    return shown


def typeset(shown, says):
    """Return a table as Markdown (".md") and as LaTeX with booktabs' lines (".tex").

    Parameters
    ----------
    shown : DataFrame
        Of strings or numbers. A named block of rows has its name in the index.
    says : str
        The caption.
    """
    n = len(shown.columns)
    named = pd.api.types.is_string_dtype(shown.index)
    header, *rows = [
        ["" if pd.isna(cell) else str(cell) for cell in row]
        for row in (shown.columns, *shown.itertuples(index=False))
    ]

    def plain(cells):
        return "| " + " | ".join(cells) + " |"

    def latex(cells):
        return " & ".join(cell.translate(LATEX) for cell in cells) + r" \\"

    markdown = [says, "", plain(header), plain(["---"] * n)]
    tabular = [latex(header), r"\midrule"]
    for i, row in enumerate(rows):
        if named and i and shown.index[i] != shown.index[i - 1]:
            block = shown.index[i]
            markdown.append(plain([f"*{block}*"] + [""] * (n - 1)))
            tabular += [r"\midrule", rf"\multicolumn{{{n}}}{{l}}{{\emph{{{block}}}}} \\"]
        markdown.append(plain(row))
        tabular.append(latex(row))
    start = [r"\begin{table*}[t]", r"\centering", rf"\caption{{{says.translate(LATEX)}}}"]
    start += [rf"\begin{{tabular}}{{{'l' * n}}}", r"\toprule"]
    end = [r"\bottomrule", r"\end{tabular}", r"\end{table*}"]
    lines = {".md": markdown, ".tex": [*start, *tabular, *end]}
    return {suffix: "\n".join([*text, ""]) for suffix, text in lines.items()}


def _hashes(name, study, sources):
    hashes = {}
    for source in sources:
        path = Path(source)
        if not path.is_absolute() and not path.exists():
            path = study.runs / str(source) / "eval.csv"
        if not path.is_file():
            raise FileNotFoundError(
                f"figure {name} names the source {source}, but {path} is missing"
            )
        hashes[_relative(path, study)] = sha256(path)
    return hashes


def _enter(study, name, notebook, hashes):
    entry = {name: {"notebook": notebook, "sources": hashes}}
    text = json.dumps(_manifest(study) | entry, indent=1, sort_keys=True)
    write_text(study.figures / "manifest.json", text + "\n")


def _manifest(study):
    path = study.figures / "manifest.json"
    return json.loads(path.read_text(encoding="utf-8")) if path.exists() else {}


def _relative(path, study):
    """Name a file relative to the study's output folder, so that manifests hold no home folder."""
    path = path.resolve()
    return str(path.relative_to(study.out)) if path.is_relative_to(study.out) else path.name
