"""Figures with sliders."""

import matplotlib.pyplot as plt
import pytest

from rlihf_lib import interact


class Shown:
    """Stands for the front end: what is displayed, and what it becomes."""

    def __init__(self):
        self.contents = []

    def __call__(self, content, display_id=False, raw=False):
        self.contents.append(content)
        return self

    def update(self, content):
        self.contents.append(content)


@pytest.fixture
def shown(monkeypatch):
    front_end = Shown()
    monkeypatch.setattr(interact, "display", front_end)
    return front_end


def draw(person, share):
    if share > 0.9:
        raise ValueError(f"share is {share:.1f}; give 0.9 at most")
    figure, ax = plt.subplots(figsize=(1, 1))
    ax.set_title(f"{person} {share:.1f}")
    return figure


def test_the_first_picture_needs_no_widget_and_a_moved_slider_draws_again(shown, monkeypatch):
    made = []
    from ipywidgets import interactive

    original = interactive.widget_from_abbrev
    monkeypatch.setattr(
        interactive, "widget_from_abbrev", lambda c: made.append(original(c)) or made[-1]
    )
    interact.explore(draw, person=["s02", "s03"], share=(0.0, 1.0, 0.1))
    controls, first = shown.contents
    assert controls["text/plain"] == "(sliders, in JupyterLab)"
    assert first.axes[0].get_title() == "s02 0.5"
    assert not plt.fignum_exists(first.number), "else the notebook shows it twice"
    person, share = made
    assert person.description == "person" and not share.continuous_update
    person.value = "s03"
    assert shown.contents[-1].axes[0].get_title() == "s03 0.5"
    share.value = 1.0
    assert "give 0.9 at most" in shown.contents[-1].data, "a wrong value is said, not raised"
