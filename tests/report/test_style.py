"""Colours that are told apart."""

import numpy as np

from rlihf_lib.report.style import LABELS, color, shades


def test_weights_get_darker():
    luminance = np.array(shades(5))[:, :3] @ [0.299, 0.587, 0.114]
    assert (np.diff(luminance) < -0.05).all()


def test_every_group_has_a_colour_of_its_own():
    assert len({color(group) for group in LABELS}) == len(LABELS)
