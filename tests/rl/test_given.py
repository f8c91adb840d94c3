"""Functions given from outside."""

from math import sqrt
from types import SimpleNamespace

import numpy as np
import pytest
from numpy import clip
from scipy.special import expit

from rlihf_lib.rl.given import given

WORTH = 2.0


def clear_reward(moment):
    return WORTH * moment.clearance


def test_a_function_is_known_by_its_source_and_by_the_values_it_refers_to(monkeypatch):
    first = given(clear_reward)
    assert first.name == "clear_reward" and given(clear_reward) == first
    monkeypatch.setitem(globals(), "WORTH", 3.0)
    assert given(clear_reward) != first
    monkeypatch.setitem(globals(), "WORTH", [3.0])
    with pytest.raises(ValueError, match="clear_reward refers to WORTH, a list"):
        given(clear_reward)


LIMITS = (0.02, 0.05)
FAR = 1.0


def near_any(moment):
    return float(any(moment.clearance < limit * FAR for limit in LIMITS))


def test_values_that_only_a_generator_reads_are_part_of_it(monkeypatch):
    first = given(near_any)
    monkeypatch.setitem(globals(), "FAR", 2.0)
    assert given(near_any) != first
    monkeypatch.setitem(globals(), "LIMITS", (0.02, len))
    with pytest.raises(ValueError, match="near_any refers to LIMITS, a tuple"):
        given(near_any)


def gains(moment):
    return moment.best - moment.remaining


def test_an_attribute_is_no_global_of_the_same_name(monkeypatch):
    first = given(gains)
    monkeypatch.setitem(globals(), "best", [1, 2])
    assert given(gains) == first


def rooted(moment):
    return sqrt(clip(moment.clearance, 0, 1)) + EXPECTED


EXPECTED = 0.5


def test_installed_functions_may_be_imported_by_name():
    assert given(rooted)(SimpleNamespace(clearance=4.0)) == 1.5


def worth(p_error, share):
    return SQUASH(p_error)


SQUASH = expit


def test_functions_of_numpy_and_scipy_are_known_by_their_name(monkeypatch):
    first = given(worth)
    assert first(0.0, 0.0) == 0.5 and given(worth) == first
    monkeypatch.setitem(globals(), "SQUASH", np.tanh)
    assert given(worth) != first
