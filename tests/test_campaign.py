"""Two minutes of the campaign against the store of results (`python -m tests.campaign`)."""

from tests.campaign import campaign


def test_nothing_is_lost_whatever_is_killed_edited_or_full():
    tally = campaign(minutes=2, seed=1)
    assert tally["tried"].sum() >= 1
    assert not tally.drop(columns="tried").any(axis=None), f"\n{tally}"
