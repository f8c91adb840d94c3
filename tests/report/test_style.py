"""Colours that are told apart."""

import numpy as np
import pytest
from matplotlib.colors import rgb_to_hsv, to_hex, to_rgb

from rlihf_lib.report.style import COLORS, LABELS, color, shades

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


def test_every_group_has_a_colour_of_its_own():
    assert len({color(group) for group in LABELS}) == len(LABELS)


@pytest.mark.parametrize("kind", BLINDNESS)
@pytest.mark.parametrize("names", [("sparse", "dense", "rlihf"), ("correct", "error")])
def test_colours_drawn_together_differ_to_the_colour_blind(kind, names):
    linear = np.array([to_rgb(COLORS[name]) for name in names]) ** 2.2
    seen = np.clip(linear @ np.transpose(BLINDNESS[kind]), 0, 1) ** (1 / 2.2)
    apart = np.linalg.norm(seen[:, None] - seen[None], axis=-1)
    assert apart[np.triu_indices(len(names), 1)].min() > 0.2
