"""A moment in which nothing is wrong, to be changed."""

import dataclasses

from rlihf_lib.task.moment import Moment

QUIET = Moment(
    remaining=0.5, gained=0.02, best=0.52, deviation=0.0, clearance=0.1,
    collided=False, grasped=True, success=False, lost=False, dropped=False, tilt=0.0, nearer=0.02,
    moved=0.02,
)  # fmt: skip


def moment(**changes):
    return dataclasses.replace(QUIET, **changes)
