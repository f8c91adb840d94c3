"""Who touches whom, and how near hand and held can come to the obstacles."""

import mujoco
import numba
import numpy as np
from scipy.optimize import lsq_linear

from rlihf_lib.task.mujoco_c import mj_geomDistance
from rlihf_lib.task.workspace import OBSTACLES

CLEARANCE_RANGE = 0.15  # metres beyond which clearance isn't measured
NATIVE_CCD_OFF = int(mujoco.mjtDisableBit.mjDSBL_NATIVECCD)


class Contacts:
    """Contacts and distances of a workspace, by what its geoms belong to.

    Parameters
    ----------
    workspace : Workspace
    """

    def __init__(self, workspace):
        self._model, self._data = workspace.sim.model._model, workspace.sim.data._data
        model, geom_ids = self._model, workspace.geom_ids
        names = [model.geom(g).name for g in range(model.ngeom)]
        self._is_can = np.isin(np.arange(model.ngeom), geom_ids["can"])
        self._is_obstacle = np.zeros(model.ngeom, bool)
        for name in OBSTACLES:
            self._is_obstacle[geom_ids[name]] = True
        self._is_thumb = np.array(["_thumb_" in n for n in names])
        self._is_finger = np.array(["_index_" in n or "_pinky_" in n for n in names])
        self._is_robot = np.array([n.startswith(("robot0", "gripper0")) for n in names])
        self.obstacles = np.flatnonzero(self._is_obstacle)
        solid = (model.geom_contype > 0) | (model.geom_conaffinity > 0)
        in_hand = np.array([n.startswith("gripper0") for n in names])
        self.hand = np.flatnonzero(in_hand & solid)
        self.hand_and_can = np.append(self.hand, geom_ids["can"])
        self._is_box = model.geom_type == mujoco.mjtGeom.mjGEOM_BOX
        self._boxes = [
            (a, b) for a in self.hand for b in self.obstacles if self._is_box[[a, b]].all()
        ]

    def touching(self):
        """Tell whether the robot, its thumb and its other fingers touch the can, and collisions.

        Returns
        -------
        can, thumb, finger, collided : bool
            `collided`: hand, arm or a can that is touched touches an obstacle.
        """
        return _touches(
            self._data.contact.geom,
            self._is_can, self._is_obstacle, self._is_thumb, self._is_finger, self._is_robot,
        )  # fmt: skip

    def clearance(self, held):
        """Distance between the hand, or the can it holds, and the nearest obstacle.

        Asked of MuJoCo's native collision code, exact to 0.1 mm. The simulation's contacts are left
        to libccd, which takes half as long, and whose distances depend on the order of asking and
        are low by up to 9 cm.

        Parameters
        ----------
        held : bool
            Whether the can counts.

        Returns
        -------
        float
            Metres, from 0 (touching) to `CLEARANCE_RANGE`.
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
        centre, size = self._data.geom_xpos, self._model.geom_size
        axes_a, axes_b = self._data.geom_xmat[[a, b]].reshape(2, 3, 3)
        limits = np.append(size[a], size[b])
        nearest = lsq_linear(
            np.hstack([axes_a, -axes_b]), centre[b] - centre[a], (-limits, limits), method="bvls"
        )
        return float(np.linalg.norm(nearest.fun))


@numba.njit(cache=True)
def _touches(pairs, is_can, is_obstacle, is_thumb, is_finger, is_robot):
    """What `touching` returns, of pairs of geoms, int array (n, 2)."""
    touching = thumb = finger = robot_hits = can_hits = False
    for i in range(len(pairs)):
        for a, b in ((pairs[i, 0], pairs[i, 1]), (pairs[i, 1], pairs[i, 0])):
            if is_can[a]:
                touching |= is_robot[b]
                thumb |= is_thumb[b]
                finger |= is_finger[b]
            if is_obstacle[a]:
                robot_hits |= is_robot[b]
                can_hits |= is_can[b]
    return touching, thumb, finger, robot_hits or (can_hits and touching)


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
