"""The ideal path, what remains of it, and how far an executed path is from it.

The ideal path leads the hand from its start over the can, down to it, up by `LIFT`, round the
obstacles on the robot's side with the clearance people prefer, over the goal and down onto it. One
number says how far a state is from the end: the *remaining path* in metres. On the ideal path it is
the length that is left; beside it, coming back costs several times the distance:

    D(x) = min_q  detour * |x - q| + length left at q,      q on the ideal path.
"""

import numba
import numpy as np

from rlihf_lib.task.moment import State

LIFT = 0.10  # metres the can is lifted before it is carried
HOVER = 0.10  # metres over the can from which the hand comes down
# Price of a metre beside the path; 1 would let the hand cut every corner. The can has to go round
# the obstacles; the hand on its way to the can may come as it likes, and a beginner's wavers.
CARRY_DETOUR, REACH_DETOUR = 2.5, 1.5
VIA = ((-0.26, -0.06), (-0.26, 0.06))  # where the path passes the bottle and the cereal box
GRASP_WORTH = 0.10  # metres: closing the fingers round the can, half of it for the hold itself
RELEASE_WORTH = 0.06  # metres: opening them round the can on the goal
# Metres of way left to the can at which closing counts fully, and not at all. Hands closed 4 cm
# over to 2.5 cm under the can's centre, or 2 cm beside it, lift it.
NEAR, FAR = 0.04, 0.08


@numba.njit(cache=True)
def _piece(point, start, direction, length, slope):
    """Length along a piece to where it is joined from `point`, and the distance to there."""
    offset = point - start
    foot = (offset * direction).sum()
    beside = np.sqrt(max((offset**2).sum() - foot**2, 0.0))
    along = min(max(foot + slope * beside, 0.0), length)
    return along, np.sqrt(beside**2 + (along - foot) ** 2)


@numba.njit(cache=True)
def _nearest(point, starts, directions, lengths):
    distance = np.inf
    for i in range(len(lengths)):
        distance = min(distance, _piece(point, starts[i], directions[i], lengths[i], 0.0)[1])
    return distance


@numba.njit(cache=True)
def _join(point, starts, directions, lengths, before, detour):
    # A metre beside the path costs `detour`, so the path is best joined further on, at the angle
    # at which what is saved along it no longer pays for the longer way across.
    slope = 1 / np.sqrt(detour**2 - 1)
    left, joined = np.inf, 0.0
    for i in range(len(lengths)):
        along, distance = _piece(point, starts[i], directions[i], lengths[i], slope)
        price = detour * distance + before[-1] - before[i] - along
        if price < left:
            left, joined = price, before[i] + along
    return left, joined


class Polyline:
    """Straight pieces between vertices, (n, 3), metres; `detour` > 1 prices a metre beside them."""

    def __init__(self, vertices, detour: float = CARRY_DETOUR):
        self.detour = detour
        vertices = np.asarray(vertices, float)
        pieces = np.diff(vertices, axis=0)
        self._starts, self._lengths = vertices[:-1], np.linalg.norm(pieces, axis=1)
        # Two equal vertices leave a piece without length, whose direction doesn't matter.
        self._directions = pieces / np.maximum(self._lengths, 1e-12)[:, None]
        self._before = np.append(0.0, np.cumsum(self._lengths))
        self.length = float(self._before[-1])

    def distance(self, point: np.ndarray) -> float:
        """Distance from `point`, (3,), to the nearest point of the path, metres."""
        return _nearest(point, self._starts, self._directions, self._lengths)

    def remaining(self, point: np.ndarray) -> tuple[float, float]:
        """Metres: least `detour` * |point - q| + length left at q, and length up to the best q."""
        pieces = self._starts, self._directions, self._lengths, self._before
        return _join(point, *pieces, self.detour)

    def at(self, length: float) -> np.ndarray:
        """Point `length` metres from the start, (3,); beyond the end, the end."""
        piece = int(np.searchsorted(self._before[:-1], length, side="right")) - 1
        along = min(length - self._before[piece], self._lengths[piece])
        return self._starts[piece] + along * self._directions[piece]


class IdealPath:
    """The ideal path of a hand, from where it starts, and of a can's centre to the goal, (3,) each.

    In metres: `reach` and `carry`, vertices (n, 3) of the way to the can and with it; the latter's
    `carry_length`, both's `length`; `start_remaining`, at the start, about `length` + 0.16.
    """

    def __init__(self, hand, can, goal):
        hand, can, goal = (np.asarray(p, float) for p in (hand, can, goal))
        up, height = np.array([0, 0, 1.0]), can[2] + LIFT
        self.reach = np.array([hand, can + HOVER * up, can])
        self.carry = np.array([can, *([*xy, height] for xy in (can[:2], *VIA, goal[:2])), goal])
        self._descent = Polyline([HOVER * up, 0 * up], REACH_DETOUR)
        self._reach, self._carry = Polyline(self.reach), Polyline(self.carry)
        self.carry_length = self._carry.length
        self.length = self._reach.length + self.carry_length
        self.start_remaining = self.remaining(State(hand, can, held=False, squeeze=0.0))

    def remaining(self, state: State) -> float:
        """Remaining path D of a state, metres; 0 with the can on the goal and the hand open."""
        if state.delivered:
            return RELEASE_WORTH * state.squeeze
        carry = self._carry.remaining(state.can)[0]
        if state.held:
            # Fingers that touch the can without squeezing it let it slip when it is lifted.
            return float(carry + 0.5 * GRASP_WORTH * (1 - state.squeeze) + RELEASE_WORTH)
        # Straight to the hovering point and down; low beside the can, where that would sweep it
        # aside, height lost costs `REACH_DETOUR`.
        offset = state.hand - state.can
        too_low = max(0.0, HOVER / 2 - offset[2])
        straight = np.linalg.norm(offset - [0, 0, HOVER]) + HOVER + REACH_DETOUR * too_low
        reach = float(min(self._descent.remaining(offset)[0], straight))
        # A hand closed too early has to open again: that is part of the way left.
        near = min(max((FAR - reach) / (FAR - NEAR), 0.0), 1.0)
        closing = GRASP_WORTH * (1 + 0.5 * state.squeeze * (1 - 2 * near))
        # Pushing the can away makes the way longer, pushing it along doesn't make it shorter.
        return float(reach + closing + max(self.carry_length, carry) + RELEASE_WORTH)

    def deviation(self, hand: np.ndarray) -> float:
        """Distance from `hand`, (3,), to the nearest point of the ideal path, metres."""
        return min(self._reach.distance(hand), self._carry.distance(hand))

    def lookahead(self, can: np.ndarray, distance: float) -> np.ndarray:
        """Point of the carry leg `distance` metres beyond the one that serves `can` best, (3,)."""
        return self._carry.at(self._carry.remaining(can)[1] + distance)


def path_efficiency(ideal: float, executed: float, completed: float) -> float:
    """Ideal length over executed length, of the part of the task that was completed.

    The paper's ratio "between the length of the ideal trajectory and the agent's actual
    trajectory" would exceed 1 for a robot that gives up early; so the ideal length is weighted by
    the share of the path completed, as success-weighted path length (Anderson et al. 2018) does.
    In [0, 1]; 0 if the hand didn't move.
    """
    return float(min(1.0, completed * ideal / executed)) if executed > 0 else 0.0
