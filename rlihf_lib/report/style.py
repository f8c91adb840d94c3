"""How figures and tables look: names, colours, sizes."""

from collections.abc import Iterable
from typing import Any

import seaborn as sns

from rlihf_lib.profiles import Profile

#: Every name under which runs are compared (`evaluations.group_of`): as people read it, its colour
#: and its dashes, which tell lines apart in black and white too.
# Okabe & Ito (2008), "Color Universal Design": told apart with every common colour blindness.
GROUPS: dict[str, tuple] = {
    "sparse": ("RL sparse", "#7F7F7F", (0, (1, 1))),
    "dense": ("RL dense", "#0072B2", (0, (4, 1.5))),
    "rlihf": ("RLIHF", "#D55E00", "solid"),
    "sparse-patience1000-discount0.98": (
        "RL sparse, tuned (discount .98)", "#009E73", (0, (3, 1, 1, 1)),
    ),
    "sparse-patience1000-discount0.99": (
        "RL sparse, tuned (discount .99)", "#56B4E9", (0, (3, 1, 1, 1, 1, 1)),
    ),
    "rlihf-ideal": ("RLIHF, ideal p", "#000000", (0, (8, 1.5))),
    "rlihf-mean": ("RLIHF, constant p", "#CC79A7", (0, (2, 1))),
    "rlihf-shuffled": ("RLIHF, shuffled p", "#999933", (0, (5, 1, 1, 1))),
    "rlihf-lay": ("RLIHF, lay observer", "#332288", (0, (6, 1, 1, 1, 1, 1))),
}  # fmt: skip
LABELS, COLORS, DASHES = (
    {group: look[part] for group, look in GROUPS.items()} for part in range(3)
)
#: Studies of other people, by the name of their folder of results.
STUDIES = {
    "ner2015": "recorded, NER 2015",
    "coadaptation": "yes/no decoder, closed loop (Ehrlich & Cheng 2018)",
}
COLORS |= {"correct": "#44AA99", "error": "#882255"}  # what EEG answers; no condition's colours
COLORS |= {"pretrain": "#F0E442", "online": "#E69F00"}  # the paper's Fig. 5: yellow, orange bars
COLORS |= {"lda": "#555555"}  # the decoder that EEGNet is compared with
LIGHTEST, DARKEST = "#EDB98F", "#552600"  # shades of RLIHF
#: Of chance levels and other lines to compare with; of single people or runs behind their mean.
REFERENCE: dict[str, Any] = {"color": "#888888", "lw": 0.8, "ls": (0, (2, 2))}
BEHIND: dict[str, Any] = {"color": "#BBBBBB", "lw": 0.7}
SHARE = (-0.03, 1.03)  # limits of an axis of shares, with room for lines at 0 and 1
COLUMN_WIDTH, PAGE_WIDTH = 3.4, 7.0  # inches of a two-column conference page (ieeeconf, letter)
SMALL, WIDEST = 7, 18  # pt of the smallest text that journals print; cm of two columns
RC = {  # on top of seaborn's "paper"
    "figure.dpi": 95,  # on screens, and in executed copies, which stay small
    "savefig.dpi": 300,
    "figure.constrained_layout.use": True,
    "legend.frameon": False,
    "axes.linewidth": 0.6,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.grid": True,
    "grid.color": "#E5E5E5",
    "grid.linewidth": 0.5,
    "xtick.major.size": 3,
    "ytick.major.size": 3,
    "pdf.fonttype": 42,  # journals refuse Type 3 fonts
}


def use_style() -> None:
    """Set the defaults of seaborn and Matplotlib for a two-column paper."""
    # Matplotlib's own font, so that figures are the same on every machine; 9.6 pt to captions' 8.
    sns.set_theme("paper", "ticks", font="DejaVu Sans", font_scale=8 / 9.6, rc=RC)


def label(group: str) -> str:
    """Return how people read a group's name; the name itself where there is no other."""
    return LABELS.get(group, group)


def color(group: str) -> str:
    """Return a group's colour, the same in every figure; dark grey where it has none."""
    return COLORS.get(group, "#444444")


def line_style(group: str) -> dict[str, Any]:
    """Return colour and dashes of a group's lines."""
    return {"color": color(group), "linestyle": DASHES.get(group, DASHES[group.split("-")[0]])}


def ordered(groups: Iterable[str]) -> list[str]:
    """Sort groups for tables and figures: as in `LABELS`, the paper's first, unknown ones last."""
    groups = set(groups)
    return [*filter(groups.__contains__, LABELS), *sorted(groups - LABELS.keys())]


def shades(weights: Iterable[float]) -> dict[float, tuple]:
    """Return a shade of RLIHF's colour for each weight of human feedback: heavier, darker.

    The weight of the main comparison has the colour itself; steps are even on either side of it.
    """
    own, weights = color("rlihf"), sorted({*weights, Profile.w_hf})
    main = weights.index(Profile.w_hf)
    lighter = sns.blend_palette([LIGHTEST, own], main + 1)[:-1]
    darker = sns.blend_palette([own, DARKEST], len(weights) - main)
    return dict(zip(weights, lighter + darker, strict=True))
