"""Colours that are told apart."""

import numpy as np
import pytest
from matplotlib.colors import rgb_to_hsv, to_hex, to_rgb

from rlihf_lib.report.style import COLORS, LABELS, color, line_style, shades

GREY = [0.299, 0.587, 0.114]
# Of linear RGB, at full severity: Machado et al. (2009), IEEE Trans. Vis. Comput. Graph. 15:1291.
BLINDNESS = {
    "protanopia": [[0.152, 1.053, -0.205], [0.115, 0.786, 0.099], [-0.004, -0.048, 1.052]],
    "deuteranopia": [[0.367, 0.861, -0.228], [0.280, 0.673, 0.047], [-0.012, 0.043, 0.969]],
    "tritanopia": [[1.256, -0.077, -0.179], [-0.078, 0.931, 0.148], [0.005, 0.691, 0.304]],
}


@pytest.mark.parametrize("weights", [(0.1, 0.4, 0.7), (0.05, 0.1, 0.2, 0.4, 0.7, 1.0), (0.9, 2)])
def test_weights_are_shades_of_rlihfs_colour_that_get_darker(weights):
    colours = shades(weights)
    assert list(colours) == sorted({*weights, 0.7})
    assert (np.diff(np.array(list(colours.values())) @ GREY) < -0.05).all()
    assert to_hex(colours[0.7]) == color("rlihf").lower()
    hues = [rgb_to_hsv(shade)[0] for shade in colours.values()]
    np.testing.assert_allclose(hues, hues[0], atol=0.01)


def test_every_group_has_a_colour_and_dashes_of_its_own():
    assert len({color(group) for group in LABELS}) == len(LABELS)
    assert len({line_style(group)["linestyle"] for group in LABELS}) == len(LABELS)
    assert line_style("dense-batch512")["linestyle"] == line_style("dense")["linestyle"]


def seen(colours, kind):
    """RGB of colours as somebody sees them."""
    linear = np.array([to_rgb(shade) for shade in colours]) ** 2.2
    return np.clip(linear @ np.transpose(BLINDNESS[kind]), 0, 1) ** (1 / 2.2)


@pytest.mark.parametrize("kind", BLINDNESS)
def test_the_papers_weights_differ_to_the_colour_blind(kind):
    steps = np.diff(seen(shades((0.1, 0.4, 0.7)).values(), kind), axis=0)
    assert np.linalg.norm(steps, axis=1).min() > 0.25


@pytest.mark.parametrize("kind", BLINDNESS)
@pytest.mark.parametrize("names", [("sparse", "dense", "rlihf"), ("correct", "error")])
def test_colours_drawn_together_differ_to_the_colour_blind(kind, names):
    colours = seen([COLORS[name] for name in names], kind)
    apart = np.linalg.norm(colours[:, None] - colours[None], axis=-1)
    assert apart[np.triu_indices(len(names), 1)].min() > 0.2
