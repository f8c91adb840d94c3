"""Figures with sliders: what a notebook draws, drawn again while a reader plays with it."""

from collections.abc import Callable
from typing import Any

import matplotlib.pyplot as plt
from IPython.display import Markdown, display
from matplotlib.figure import Figure

WIDGET = "application/vnd.jupyter.widget-view+json"


def explore(draw: Callable[..., Figure], **controls: Any) -> None:
    """Show a figure, in JupyterLab below a control for each of its parameters.

    Without widgets (papermill, GitHub, a PDF) the figure stands alone, as it was drawn first.

    Parameters
    ----------
    draw : callable
        Takes the controls' values by name and returns a figure; what it raises as a ValueError is
        shown in the figure's place.
    **controls
        An ipywidgets widget, or an abbreviation of one: a list of choices, of which the first is
        shown first; a range `(low, high, step)`, of which the middle is.
    """
    from ipywidgets import VBox, interactive

    widgets = {name: interactive.widget_from_abbrev(c) for name, c in controls.items()}
    for name, widget in widgets.items():
        widget.description = name.replace("_", " ")
        if widget.has_trait("continuous_update"):
            widget.continuous_update = False  # figures take a while

    def picture():
        try:
            figure = draw(**{name: widget.value for name, widget in widgets.items()})
        except ValueError as error:
            return Markdown(str(error))
        plt.close(figure)  # else the notebook shows it once more
        return figure

    view = VBox([*widgets.values()])._repr_mimebundle_()[WIDGET]
    # Where there are no widgets, the words stand instead of a `VBox(children=...`.
    display({WIDGET: view, "text/plain": "(sliders, in JupyterLab)"}, raw=True)
    shown = display(picture(), display_id=True)
    for widget in widgets.values():
        widget.observe(lambda _: shown.update(picture()), "value")
