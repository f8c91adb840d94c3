"""Functions given from outside."""

import numpy as np
import pytest
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


def worth(p_error, share):
    return SQUASH(p_error)


SQUASH = expit


def test_functions_of_numpy_and_scipy_are_known_by_their_name(monkeypatch):
    first = given(worth)
    assert first(0.0, 0.0) == 0.5 and given(worth) == first
    monkeypatch.setitem(globals(), "SQUASH", np.tanh)
    assert given(worth) != first
