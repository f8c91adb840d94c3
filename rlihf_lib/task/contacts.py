"""Who touches whom, and how near hand and held can come to the obstacles."""

from itertools import product
from typing import NamedTuple

import mujoco
import numba
import numpy as np
from scipy.optimize import lsq_linear

from rlihf_lib.task.mujoco_c import mj_geomDistance
from rlihf_lib.task.workspace import OBSTACLES, Workspace

CLEARANCE_RANGE = 0.15  # metres beyond which clearance isn't measured
NATIVE_CCD_OFF = int(mujoco.mjtDisableBit.mjDSBL_NATIVECCD)
CAN, OBSTACLE, ROBOT, THUMB, FINGER = 1, 2, 4, 8, 16  # what a geom belongs to, one bit each


class Touch(NamedTuple):
    can: bool  # whether the robot touches the can
    pinched: bool  # whether thumb and an opposing finger do
    collided: bool  # whether hand, arm or a can that is touched touches an obstacle


class Contacts:
    """Contacts and distances of a workspace, by what its geoms belong to."""

    def __init__(self, workspace: Workspace):
        model = self._model = workspace.sim.model._model
        self._data, can = workspace.sim.data._data, workspace.geom_ids["can"]
        self.obstacles = np.sort(np.concatenate([workspace.geom_ids[name] for name in OBSTACLES]))
        names = np.array([model.geom(g).name for g in range(model.ngeom)])
        self._parts = np.array([_parts(name) for name in names])
        self._parts[can] |= CAN
        self._parts[self.obstacles] |= OBSTACLE
        self.hand = np.flatnonzero(workspace.solid & np.char.startswith(names, "gripper0"))
        self.hand_and_can = np.append(self.hand, can)
        self._is_box = model.geom_type == mujoco.mjtGeom.mjGEOM_BOX
        self._boxes = list(product(*(g[self._is_box[g]] for g in (self.hand, self.obstacles))))

    def touching(self) -> Touch:
        """Tell who touches the can, and whether anything collides."""
        can, obstacle = _touched(self._data.contact.geom, self._parts)
        touched, pinched = bool(can & ROBOT), bool(can & THUMB and can & FINGER)
        return Touch(touched, pinched, bool(obstacle & ROBOT or (obstacle & CAN and touched)))

    def clearance(self, held: bool) -> float:
        """Metres, 0 to `CLEARANCE_RANGE`, from the hand or the can it holds to the next obstacle.

        Asked of MuJoCo's native collision code, exact to 0.1 mm. The simulation's contacts are left
        to libccd, which takes half as long, and whose distances depend on the order of asking and
        are low by up to 9 cm.
        """
        option, flags = self._model.opt, self._model.opt.disableflags
        option.disableflags = flags & ~NATIVE_CCD_OFF
        closest, doubtful = _closest(
            self._model._address, self._data._address, self.hand_and_can if held else self.hand,
            self.obstacles, self._is_box, self._data.geom_xpos, self._model.geom_rbound,
        )  # fmt: skip
        option.disableflags = flags
        if doubtful:
            closest = min(closest, *(self._between_boxes(*pair) for pair in self._boxes))
        return closest

    def _between_boxes(self, a, b):
        """Distance between two boxes, metres: the points x, y of least |x - y|, within bounds."""
        centre, limits = self._data.geom_xpos, self._model.geom_size[[a, b]].ravel()
        axes_a, axes_b = self._data.geom_xmat[[a, b]].reshape(2, 3, 3)
        axes, apart = np.hstack([axes_a, -axes_b]), centre[b] - centre[a]
        return float(np.linalg.norm(lsq_linear(axes, apart, (-limits, limits), "bvls").fun))


def _parts(name):
    finger = "_index_" in name or "_pinky_" in name
    robot = name.startswith(("robot0", "gripper0"))
    return ROBOT * robot | THUMB * ("_thumb_" in name) | FINGER * finger


@numba.njit(cache=True)
def _touched(pairs, parts):
    """Bits of all that touches the can, and an obstacle, by pairs of geoms, int array (n, 2)."""
    can = obstacle = 0
    for i in range(len(pairs)):
        for a, b in ((pairs[i, 0], pairs[i, 1]), (pairs[i, 1], pairs[i, 0])):
            if parts[a] & CAN:
                can |= parts[b]
            if parts[a] & OBSTACLE:
                obstacle |= parts[b]
    return can, obstacle


@numba.njit(cache=True)
def _closest(model, data, moving, obstacles, is_box, centre, radius):
    """Distance between the nearest two geoms, and how many pairs of boxes it leaves out.

    Spheres round the geoms tell which can't be nearest. Of two boxes MuJoCo sometimes says that
    they touch, a distance of 0, when they are centimetres apart (issue 3383, from 3.3.5 on).
    """
    closest, doubtful = CLEARANCE_RANGE, 0
    for a in moving:
        for b in obstacles:
            apart = np.sqrt(((centre[a] - centre[b]) ** 2).sum()) - radius[a] - radius[b]
            if apart < closest:
                distance = mj_geomDistance(model, data, a, b, closest, 0)
                if distance == 0.0 and is_box[a] and is_box[b]:
                    doubtful += 1
                else:
                    closest = min(closest, distance)
    return max(closest, 0.0), doubtful
