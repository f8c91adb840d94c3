"""What can be seen of one control step, by an engineer and by a lay person.

The lay person's task has no ideal path and no remaining length: the hand has to get to the can and
close, the can has to go up, over to the goal and down, the hand has to open (`Stages`).
"""

import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

LIFTED = 0.05  # metres of lift that tell carrying from pushing
STAGES = ("reach", "close", "lift", "carry", "lower", "open")
AT_CAN = 0.03  # metres between the hand's and the can's centre from which it may close
OVER_GOAL = 0.04  # metres between can and goal, seen from above
FINGERS = 0.05  # metres that closing or opening the hand looks like
NEXT_STAGE = 0.05  # metres that reaching a stage for the first time looks like


@dataclass(frozen=True)
class Moment:
    """What an observer can see of one control step; lengths in metres."""

    remaining: float  # path after the step (`IdealPath.remaining`)
    gained: float  # remaining path before the step minus after it
    best: float  # smallest remaining path of the episode before the step
    deviation: float  # of the hand from the ideal path
    clearance: float  # between hand or held can and the nearest obstacle, at most 15 cm
    collided: bool  # hand, arm or held can touches an obstacle
    grasped: bool  # the can is held by thumb and opposing finger, or lifted so and not dropped yet
    success: bool  # the can stands on the goal at rest, let go there and not dropped from above
    lost: bool  # the can has left the table or lies on its side
    dropped: bool  # the hand lost the can in this step, other than on the goal
    tilt: float  # between the can's axis and the vertical, rad
    nearer: float  # than ever before to where hand or can has to go next (`Stages`)
    moved: float  # by the hand in the step

    def __deepcopy__(self, memo) -> "Moment":
        """Stay as it is: SB3 copies every step's info, and nobody changes a moment."""
        return self


class State(NamedTuple):
    hand: np.ndarray  # position, metres, (3,)
    can: np.ndarray  # position of its centre, metres, (3,)
    held: bool  # whether the fingers hold the can
    squeeze: float  # how far the fingers are told to close, 0 open to 1 closed
    delivered: bool = False  # whether the can stands on the goal: what is left is to let it go


class Stages:
    """Remembers how near each stage has come to its end in an episode; `goal` is the can's."""

    def __init__(self, goal: np.ndarray):
        self._goal, self._least = goal, dict[str, float]()
        self.stage = STAGES[0]  # the stage of the last step

    def nearer(self, state: State) -> float:
        """Metres by which the present stage is nearer to its end than ever before."""
        stage, left = self._present(state)
        self.stage = stage
        before = self._least.get(stage)
        self._least[stage] = left if before is None else min(before, left)
        if before is not None:
            return max(0.0, before - left)
        farthest = max(self._least, key=STAGES.index) == stage
        return NEXT_STAGE if farthest and len(self._least) > 1 else 0.0

    def _present(self, state):
        """Return the present stage and the metres that are left of it."""
        apart, lift = math.dist(state.hand, state.can), state.can[2] - self._goal[2]
        away = math.dist(state.can[:2], self._goal[:2])
        if state.delivered:
            return "open", FINGERS * state.squeeze
        if not state.held:
            return ("reach", apart) if apart > AT_CAN else ("close", FINGERS * (1 - state.squeeze))
        if away < OVER_GOAL:
            return "lower", lift
        if "carry" not in self._least and lift < LIFTED:
            return "lift", LIFTED - lift
        return "carry", away
