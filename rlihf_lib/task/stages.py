"""The task as a lay person sees it: what comes next, and whether it is coming nearer.

No ideal path, no remaining length: the hand has to get to the can and close, the can has to go up,
over to the goal and down, the hand has to open.
"""

import math

STAGES = ("reach", "close", "lift", "carry", "lower", "open")
AT_CAN = 0.03  # metres between the hand's and the can's centre from which it may close
OVER_GOAL = 0.04  # metres between can and goal, seen from above
FINGERS = 0.05  # metres that closing or opening the hand looks like
NEXT_STAGE = 0.05  # metres that reaching a stage for the first time looks like


class Stages:
    """Remembers how near each stage has come to its end in an episode.

    Attributes
    ----------
    stage : str
        The present one, of `STAGES`.
    """

    def __init__(self):
        self._least = {}
        self.stage = STAGES[0]

    def nearer(self, hand, can, goal, height, held, delivered, squeeze):
        """Tell how much nearer than ever before the present stage is to its end.

        Parameters
        ----------
        hand, can, goal : ndarray, shape (3,)
            Centres, metres.
        height : float
            To which the can has to be lifted before it is carried, metres.
        held, delivered : bool
            Whether the hand holds the can; whether it stands on the goal.
        squeeze : float
            How far the fingers are told to close, 0 to 1.

        Returns
        -------
        float
            Metres, 0 for no nearer; `NEXT_STAGE` for a stage reached for the first time.
        """
        apart, lift = math.dist(hand, can), can[2] - goal[2]
        away = math.dist(can[:2], goal[:2])
        if delivered:
            stage, left = "open", FINGERS * squeeze
        elif not held and apart > AT_CAN:
            stage, left = "reach", apart
        elif not held:
            stage, left = "close", FINGERS * (1 - squeeze)
        elif away < OVER_GOAL:
            stage, left = "lower", lift
        elif "carry" not in self._least and lift < height:
            stage, left = "lift", height - lift
        else:
            stage, left = "carry", away
        self.stage = stage
        before = self._least.get(stage)
        self._least[stage] = left if before is None else min(before, left)
        if before is None:
            first = all(STAGES.index(stage) >= STAGES.index(other) for other in self._least)
            return NEXT_STAGE if first and len(self._least) > 1 else 0.0
        return max(0.0, before - left)
