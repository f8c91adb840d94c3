"""The ideal path, and what remains of it."""

from itertools import pairwise

import numpy as np
import pytest

from rlihf_lib.task.moment import State
from rlihf_lib.task.path import RELEASE_WORTH, IdealPath, Polyline, path_efficiency

CAN, GOAL, HAND = [-0.07, -0.2, 0.84], [-0.07, 0.2, 0.84], [-0.19, -0.15, 1.0]


def _walk(vertices):
    """Points every 5 mm along a polyline."""
    return np.vstack(
        [np.linspace(a, b, 1 + int(np.linalg.norm(b - a) / 0.005)) for a, b in pairwise(vertices)]
    )


def test_remaining_path_falls_along_the_ideal_path():
    path = IdealPath(HAND, CAN, GOAL)
    reach = [path.remaining(State(p, np.array(CAN), False, 0.0)) for p in _walk(path.reach)]
    carry = [path.remaining(State(p, p, True, 1.0)) for p in _walk(path.carry)]
    assert np.diff(reach).max() < 1e-9 and np.diff(carry).max() < 1e-9
    assert reach[-1] > carry[0] and carry[-1] == pytest.approx(RELEASE_WORTH)
    end = path.carry[-1]
    opening = [path.remaining(State(end, end, True, c, delivered=True)) for c in (1, 0.5, 0)]
    assert opening == pytest.approx([RELEASE_WORTH, RELEASE_WORTH / 2, 0])
    assert carry[0] == pytest.approx(path.carry_length + RELEASE_WORTH)


def test_ideal_path_itself_has_efficiency_one_and_deviation_zero():
    path = IdealPath(HAND, CAN, GOAL)
    walk = np.vstack([_walk(path.reach), _walk(path.carry)])
    assert path_efficiency(path.length, Polyline(walk).length, 1.0) == pytest.approx(1)
    assert max(path.deviation(p) for p in walk) < 1e-6


def test_closing_brings_nearer_where_it_grasps_and_squeezing_where_the_can_is_held():
    path, can = IdealPath(HAND, CAN, GOAL), np.array(CAN)

    def gain(height, grasped):
        hand = can + height * np.array([0, 0, 1])
        return np.subtract(*(path.remaining(State(hand, can, grasped, c)) for c in (0.0, 1.0)))

    assert gain(0.03, grasped=False) == pytest.approx(0.05)
    assert gain(0.09, grasped=False) == pytest.approx(-0.05)
    assert gain(0.0, grasped=True) == pytest.approx(0.05)


def test_pushing_the_can_makes_the_way_longer_but_never_shorter():
    path, can, along = IdealPath(HAND, CAN, GOAL), np.array(CAN), np.array([0, 0.1, 0])
    here, on, off = (
        path.remaining(State(where, where, False, 1.0)) for where in (can, can + along, can - along)
    )
    assert on == pytest.approx(here) and off > here + 0.1


def test_standing_still_and_detours_are_not_efficient():
    assert path_efficiency(1.0, 0.0, 0.0) == 0
    assert path_efficiency(1.0, 2.0, 1.0) == 0.5
    assert path_efficiency(1.0, 0.5, 0.1) == pytest.approx(0.2)


def test_straight_line_from_can_to_goal_is_longer_than_the_ideal_path_says():
    path = IdealPath(HAND, CAN, GOAL)
    middle = np.array([-0.07, 0.0, 0.84])
    left = path.remaining(State(middle, middle, held=True, squeeze=1.0)) - RELEASE_WORTH
    assert left > 0.9 * path.carry_length / 2
