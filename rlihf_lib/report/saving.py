"""Where figures and tables are saved, and what each figure was drawn from: `manifest.json`."""

import json
import re
import textwrap
from pathlib import Path

import pandas as pd
from matplotlib import rcParams
from matplotlib.figure import Figure
from matplotlib.text import Text

from rlihf_lib.files import atomic_path, locked, sha256, write_csv, write_text
from rlihf_lib.report.style import SMALL, WIDEST
from rlihf_lib.study import REPOSITORY

# Needs booktabs and graphicx; a table that is wider than the page is made as wide.
FIT = r"\resizebox{\ifdim\width>\linewidth\linewidth\else\width\fi}{!}{%"
ESCAPES = {c: f"\\{c}" for c in "#$%&_{}"} | {c: f"${c}$" for c in "<>"}
ESCAPES |= {"\\": r"\textbackslash{}", "~": r"\textasciitilde{}", "^": r"\textasciicircum{}"}
ESCAPES |= {"±": r"$\pm$", "·": r"$\cdot$", "–": "--", "↑": r"$\uparrow$", "↓": r"$\downarrow$"}
ESCAPES |= {"ρ": r"$\rho$", "≈": r"$\approx$"}


def caption(study, says: str = "") -> str:
    """Return what everything saved must own up to: whose EEG, which profile, how many of what."""
    return " · ".join(filter(None, [study.eeg_label, f"profile {study.profile.name}", says]))


def save_figure(fig: Figure, study, name: str, notebook: str, sources=(), says: str = "") -> None:
    """Write the caption under a figure, save it as PDF and PNG, enter it in `manifest.json`.

    In `figures/<study>/`; `notebook`, such as "02_loso_decoder", draws it from `sources`: files, or
    ids of runs (their `eval.csv`). `says`, such as "3 people x 2 seeds", is for the `caption`.
    A source that does not exist raises FileNotFoundError: a figure from nowhere is
    not saved. Nor is what print can't show, a ValueError: a figure wider than two columns, or text
    below 7 pt.
    """
    hashes = hash_sources(study, name, sources)
    letters = int(19 * fig.get_figwidth())  # of 7 pt, 19 an inch
    words = textwrap.fill(caption(study, says).replace(" %", "\N{NO-BREAK SPACE}%"), letters)
    fig.supxlabel(words, fontsize=SMALL, color="#555555")
    _require_printable(fig, name)
    engine, shown = fig.get_layout_engine(), fig.dpi
    if engine:
        fig.set_dpi(rcParams["savefig.dpi"])  # at which letters are wider than on a screen
        engine.execute(fig)
        engine.execute(fig)  # once more, for the first may have changed the ticks
        fig.set_dpi(shown)
    fig.set_layout_engine("none")  # laid out once, not again for each file
    # With a date or a software version, equal data would give unequal files.
    for suffix, field in ((".pdf", "CreationDate"), (".png", "Software")):
        with atomic_path(study.figures / f"{name}{suffix}") as temporary:
            fig.savefig(temporary, metadata={field: None})
    fig.set_layout_engine(engine or "none")
    enter(study, name, notebook, hashes)


def _require_printable(fig, name):
    if (width := 2.54 * fig.get_figwidth()) > WIDEST:
        raise ValueError(f"figure {name} is {width:.1f} cm wide; {WIDEST} cm is the most")
    for text in fig.findobj(Text):
        words, size, shown = text.get_text(), text.get_fontsize(), text.get_visible()
        if words and size < SMALL and shown and (text.axes is None or text.axes.get_visible()):
            raise ValueError(f"figure {name}: {words!r} has {size:g} pt; {SMALL} pt is the least")


def manifest(figures: Path) -> dict:
    """Read what a folder's figures were drawn from: name -> notebook, sources with their hashes.

    A ValueError says if the file is damaged.
    """
    path = figures / "manifest.json"
    try:
        entries = json.loads(path.read_text(encoding="utf-8")) if path.exists() else {}
        if not all(entry.keys() == {"notebook", "sources"} for entry in entries.values()):
            raise ValueError("a figure without notebook and sources")
    except (ValueError, AttributeError) as error:
        raise ValueError(
            f"{path} is damaged ({error}); delete it, each figure that is drawn enters itself anew"
        ) from error
    return entries


def enter(study, name: str, notebook: str, hashes: dict) -> None:
    """Enter a figure in the manifest, into which several notebooks may write at once."""
    with locked(study.figures / ".manifest.lock"):
        entries = manifest(study.figures) | {name: {"notebook": notebook, "sources": hashes}}
        text = json.dumps(entries, indent=1, sort_keys=True) + "\n"
        write_text(study.figures / "manifest.json", text)


def stale(study) -> list[str]:
    """Name the figures whose sources are gone or have changed since they were drawn."""

    def unchanged(source, known):
        paths = [folder / source for folder in (study.out, REPOSITORY)]
        return any(path.is_file() and sha256(path) == known for path in paths)

    sources = {name: entry["sources"].items() for name, entry in manifest(study.figures).items()}
    return [name for name in sources if not all(unchanged(*source) for source in sources[name])]


def hash_sources(study, name: str, sources) -> dict[str, str]:
    """Hash a figure's sources (`save_figure`).

    Named relative to the study's output folder, those of the library to the repository.
    """
    hashes = {}
    for source in sources:
        path = REPOSITORY / source  # where `source` is absolute, just that
        if not path.is_file():
            path = study.runs / str(source) / "eval.csv"
        if not path.is_file():
            raise FileNotFoundError(f"figure {name} is drawn from {source}, but {path} is missing")
        path = path.resolve()
        # Manifests hold no home folder.
        folder = study.out if path.is_relative_to(study.out) else REPOSITORY
        inside = path.is_relative_to(folder)
        hashes[str(path.relative_to(folder)) if inside else path.name] = sha256(path)
    return hashes


def save_table(
    study, name: str, table: pd.DataFrame, shown: pd.DataFrame | None = None, says: str = ""
) -> pd.DataFrame:
    """Write a table as `tables/<name>.csv` and, as people read it, as Markdown and as LaTeX.

    The csv holds all numbers of `table`, in full precision; the others, under a caption that says
    what the numbers are, what is `shown` (`table` if None), which is returned.
    """
    shown = table if shown is None else shown
    write_csv(study.tables / f"{name}.csv", table)
    for suffix, text in typeset(shown, caption(study, says), name).items():
        write_text(study.tables / f"{name}{suffix}", text)
    return shown


def typeset(shown: pd.DataFrame, says: str, name: str = "") -> dict[str, str]:
    """Return a table with its caption as Markdown (".md") and as LaTeX with booktabs (".tex").

    There it can be referred to as `tab:name`. An index of names parts blocks of rows: each has a
    line, and its name above it.
    """
    n, named = len(shown.columns), pd.api.types.is_string_dtype(shown.index)
    cells = shown.astype(object).where(shown.notna(), "").astype(str)
    rows = [cells.columns, ["---"] * n, *cells.to_numpy()]
    markdown = ["| " + " | ".join(row) + " |" for row in rows]
    cells.columns = [_latex(column) for column in cells]
    latex = cells.map(_latex).to_latex(index=False, caption=_latex(says), label=f"tab:{name}")
    lines = latex.replace("{table}", "{table*}").splitlines()
    body = lines.index(r"\midrule") + 1
    for i in reversed(range(len(cells) if named else 0)):
        block, before = shown.index[i], shown.index[i - 1] if i else ""
        if block != before:
            markdown.insert(2 + i, f"| *{block}*" + " | " * (n - 1) + " |")
            heading = rf"\multicolumn{{{n}}}{{l}}{{\emph{{{_latex(block)}}}}} \\"
            lines[body + i : body + i] = [*[r"\midrule"] * bool(i), heading]
    table = next(i for i, line in enumerate(lines) if line.startswith(r"\begin{tabular}"))
    lines[table:table], lines[-1:-1] = [FIT], ["}"]
    lines[1:1] = [r"\centering\footnotesize\setlength{\tabcolsep}{3pt}"]
    texts = {".md": [says, "", *markdown], ".tex": lines}
    return {suffix: "\n".join([*text, ""]) for suffix, text in texts.items()}


def _latex(text):
    """Escape a text; a minus is one, not a hyphen."""
    return re.sub(r"(?<!\w)-(?=[\d ])", "$-$", text.translate(str.maketrans(ESCAPES)))
