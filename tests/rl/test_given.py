"""Functions given from outside."""

import pytest

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
