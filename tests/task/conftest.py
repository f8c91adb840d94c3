"""The environment that most tests of the task play in."""

import pytest

from rlihf_lib.task.gym_env import PickPlaceEnv


@pytest.fixture(scope="module")
def env():
    environment = PickPlaceEnv(horizon=120)
    yield environment
    environment.close()
