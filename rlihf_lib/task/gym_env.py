"""The Gymnasium face of the workspace.

robosuite's own `GymWrapper` reports the horizon as `terminated`, so that a learner never bootstraps
at the time limit, and `reset(seed=)` does not seed the placement: hence this adapter.
"""

import math
from dataclasses import dataclass

import gymnasium as gym
import numpy as np

from rlihf_lib.task.contacts import CLEARANCE_RANGE, Contacts
from rlihf_lib.task.control import ARM_DOFS, Controller, StockController
from rlihf_lib.task.path import IdealPath, path_efficiency
from rlihf_lib.task.stages import Stages
from rlihf_lib.task.workspace import CLOSED_ANGLE, OBSTACLES, OPEN_ANGLE, TABLE_HEIGHT, Workspace

PLACED_WITHIN = 0.04  # metres between the can's and the goal's centre
LIFTED = 0.05  # metres of lift that tell carrying from pushing
LOWERED = 0.03  # metres over the goal from which letting go is placing, not dropping
LEANING = math.radians(18)  # up to which a can at the goal may still come to stand when let go
FALLEN = math.radians(60)  # from which a can that nobody holds lies
STANDING = math.radians(5)  # up to which a can that was let go stands
AT_REST = (0.02, 0.3)  # speed (m/s) and spin (rad/s) up to which it is at rest
CENTRE = np.array([0, 0, TABLE_HEIGHT + 0.1])  # of the space over the table
LENGTH_SCALE, SPEED_SCALE = 0.2, 0.5  # observation units: 0.2 m and 0.5 m/s
CLOSE_RANGE = 0.03  # metres; grasping and placing take place at a few centimetres
IN_HAND = 0.06  # metres between hand and can up to which a lifted can hasn't been dropped
OBSERVATION = (
    # entry, size, unit
    ("hand position from the table's centre", 3, "0.2 m"),
    ("hand velocity", 3, "0.5 m/s"),
    ("hand's goal from hand", 3, "0.05 m"),
    ("can from hand", 3, "0.2 m"),
    ("can's upward axis, x and y", 2, "1"),
    ("can's velocity", 3, "0.5 m/s"),
    ("goal from can", 3, "0.2 m"),
    ("can from hand, and goal from can, at close range", 6, "tanh of 0.03 m"),
    *((f"{name} from hand", 3, "0.2 m") for name in OBSTACLES),
    ("finger closure, 0 open to 1 closed", 1, "1"),
    ("fingers as commanded, 0 open to 1 closed", 1, "1"),
    ("can is held", 1, "0 or 1"),
    ("can has been lifted 5 cm in this episode", 1, "0 or 1"),
    ("setback: progress lost since the best in memory", 1, "0.05 m, at most 2"),
)


@dataclass(frozen=True)
class Moment:
    """What an observer can see of one control step; lengths in metres."""

    remaining: float
    """Remaining path after the step (`IdealPath.remaining`)."""
    gained: float
    """Remaining path before the step minus after it."""
    best: float
    """Smallest remaining path of the episode before the step, metres."""
    deviation: float
    """Distance of the hand from the ideal path."""
    clearance: float
    """Distance between hand or held can and the nearest obstacle, at most 15 cm."""
    collided: bool
    """Whether hand, arm or held can touches an obstacle."""
    grasped: bool
    """Whether the can is held: by thumb and opposing finger, or lifted so and not dropped yet."""
    success: bool
    """Whether the can stands on the goal at rest, let go there and not dropped from above."""
    lost: bool
    """Whether the can has left the table or lies on its side."""
    dropped: bool
    """Whether the hand lost the can in this step, other than on the goal."""
    tilt: float
    """Angle between the can's axis and the vertical, rad."""
    nearer: float
    """How much nearer than ever before hand or can has come to where it has to go next, as a lay
    person sees it (`rlihf_lib.task.stages`)."""

    def __deepcopy__(self, memo):
        """Stay as it is: SB3 copies every step's info, and nobody changes a moment."""
        return self


class PickPlaceEnv(gym.Env):
    """Obstacle-avoiding pick-and-place with the Kinova Gen2.

    Action: Box(-1, 1, (4,)): hand displacement along x, y, z (1 = 3 cm), aperture of the hand (-1
    open, 1 closed round a can; beyond +-2/3 fully). Observation: Box, entries and units in
    `OBSERVATION`. Reward: 1 in the step that places the can, else 0; training rewards are made of
    `info["moment"]` (`rlihf_lib.rl.rewards`). `terminated`: the can stands on the goal, or is lost.
    `truncated`: the horizon, or `patience`.

    Parameters
    ----------
    horizon : int
        Steps after which an episode is truncated (paper: 1000).
    patience : int, optional
        Steps without getting further than ever before in the episode after which it is truncated,
        as somebody would stop and reset a robot that is stuck.
    control_freq : float
        Control steps per second.
    workspace : Workspace, optional
        To use instead of a new, fast one; with `Workspace(fast=False)` robosuite's own `step`
        drives the same task, several times slower.

    Attributes
    ----------
    observation : ndarray, float32
        Of the present state, as `reset` and `step` return it.
    """

    metadata = {"render_modes": []}  # noqa: RUF012 (Gymnasium's own declaration)

    def __init__(self, horizon=1000, patience=None, control_freq=10, workspace=None):
        self.horizon, self.patience = horizon, patience or horizon
        self.workspace = workspace or Workspace(control_freq=control_freq)
        self.controller = (Controller if self.workspace.fast else StockController)(self.workspace)
        self.model, self.data = self.controller.model, self.controller.data
        size = sum(entry[1] for entry in OBSERVATION)
        self.observation_space = gym.spaces.Box(-np.inf, np.inf, (size,), np.float32)
        self.action_space = gym.spaces.Box(-1.0, 1.0, (4,), np.float32)
        self.contacts = Contacts(self.workspace)
        self._can_body = self.workspace.body_ids["can"]
        self._can_dofs = self.model.joint(self.workspace.objects[0].joints[0]).dofadr[0]
        self._obstacle_bodies = np.array([self.workspace.body_ids[name] for name in OBSTACLES])

    def reset(self, *, seed=None, options=None):
        """Start an episode; `seed` seeds this and, through it, all later placements."""
        super().reset(seed=seed)
        if seed is not None:
            self.workspace.reseed(seed)
        self.workspace.reset()
        self.controller.reset()
        self.steps = self.advanced = 0
        self.travelled = 0.0
        self.squared_deviation = 0.0
        self.collisions = 0
        self.colliding = False
        self.min_clearance = CLEARANCE_RANGE
        can = self.body("can")
        self.goal = np.array([*self.workspace.placement["goal"][:2], can[2]])
        self.path = IdealPath(self.controller.hand, can, self.goal)
        self.remaining = self.best = self.path.start_remaining
        self.grasped = self.lifted = self.lowered = False
        self.stages = Stages()
        self.observation = self._observe()
        return self.observation, {}

    def step(self, action):
        """Advance one control step (Gymnasium API)."""
        action = np.asarray(action, float).clip(-1, 1)
        before = self.controller.hand.copy()
        self.controller.advance(action)
        self.steps += 1
        moment = self._judge(before)
        terminated = moment.success or moment.lost
        stuck = self.steps - self.advanced >= self.patience
        truncated = not terminated and (stuck or self.steps >= self.horizon)
        info = {"moment": moment, "is_success": moment.success}
        if terminated or truncated:
            info["metrics"] = self.metrics(moment.success)
        self.observation = self._observe()
        return self.observation, float(moment.success), terminated, truncated, info

    def _judge(self, before):
        """Measure what happened in the step that began with the hand at `before`."""
        hand, can = self.controller.hand.copy(), self.body("can")
        touching_can, thumb, finger, collided = self.contacts.touching()
        held_before = self.grasped
        # Contacts of a can that is carried flicker; only one that leaves the hand is dropped.
        aloft = can[2] > self.goal[2] + 0.005 and math.dist(hand, can) < IN_HAND
        self.grasped = bool((thumb and finger) or (held_before and aloft))
        tilt = math.acos(min(max(self.data.xmat[self._can_body][8], -1.0), 1.0))
        at_goal = math.dist(can[:2], self.goal[:2]) < PLACED_WITHIN
        self.lifted = self.lifted or bool(self.grasped and can[2] > self.goal[2] + LIFTED)
        if self.grasped and touching_can:  # else the can may be falling past the height asked for
            self.lowered = bool(at_goal and can[2] < self.goal[2] + LOWERED)
        down = abs(can[2] - self.goal[2]) < 0.01 and tilt < LEANING
        delivered = bool(self.lifted and self.lowered and at_goal and down)
        success = delivered and not touching_can and tilt < STANDING and self._can_rests()
        off_table = np.abs(can[:2]).max() > 0.4 or can[2] < TABLE_HEIGHT
        lost = bool(off_table or (tilt > FALLEN and not self.grasped))
        squeeze = self.squeeze()
        remaining = self.path.remaining(hand, can, self.grasped, squeeze, delivered)
        remaining = 0.0 if success else remaining
        clearance = self.contacts.clearance(self.grasped)
        deviation = self.path.deviation(hand)
        moment = Moment(
            remaining=remaining,
            gained=self.remaining - remaining,
            best=self.best,
            deviation=deviation,
            clearance=clearance,
            collided=collided,
            grasped=self.grasped,
            success=success,
            lost=lost,
            dropped=held_before and not self.grasped and not delivered,
            tilt=tilt,
            nearer=self.stages.nearer(
                hand, can, self.goal, LIFTED, self.grasped, delivered, squeeze
            ),
        )
        self.remaining = remaining
        if remaining < self.best:
            self.best, self.advanced = remaining, self.steps
        self.travelled += math.dist(hand, before)
        self.squared_deviation += deviation**2
        self.collisions += collided and not self.colliding
        self.colliding = collided
        self.min_clearance = min(self.min_clearance, clearance)
        return moment

    def closure(self):
        """How far the fingers are closed, 0 open to 1 closed."""
        return _closure(sum(self.data.qpos[ARM_DOFS : ARM_DOFS + 6 : 2]) / 3)

    def squeeze(self):
        """How far the fingers are told to close, 0 open to 1 closed."""
        return _closure(self.controller.gripper.angle)

    def body(self, name):
        """Centre of the can or of an obstacle, metres, shape (3,)."""
        return self.data.xpos[self.workspace.body_ids[name]].copy()

    def _can_rests(self):
        velocity = self.data.qvel[self._can_dofs : self._can_dofs + 6]
        speed, spin = np.linalg.norm(velocity[:3]), np.linalg.norm(velocity[3:])
        return bool(speed < AT_REST[0] and spin < AT_REST[1])

    def metrics(self, success):
        """Metrics of the episode so far, by the names of `eval.csv`."""
        completed = 1.0 - self.best / self.path.start_remaining
        return {
            "success": int(success),
            "path_efficiency": path_efficiency(self.path.length, self.travelled, completed),
            "path_deviation": float(np.sqrt(self.squared_deviation / self.steps)),
            "collisions": self.collisions,
            "min_clearance": self.min_clearance,
            "completed": completed,
            "steps": self.steps,
        }

    def _observe(self):
        hand, can = self.controller.hand, self.body("can")
        velocity = self.controller.hand_velocity()
        up = self.data.xmat[self._can_body][2:6:3]
        can_velocity = self.data.cvel[self._can_body][3:]
        obstacles = self.data.xpos[self._obstacle_bodies] - hand
        reach, carry = can - hand, self.goal - can
        setback = min((self.remaining - self.best) / 0.05, 2.0)
        return np.concatenate(
            [
                (hand - CENTRE) / LENGTH_SCALE,
                velocity / SPEED_SCALE,
                (self.controller.goal_pos - hand) / 0.05,
                reach / LENGTH_SCALE,
                up,
                can_velocity / SPEED_SCALE,
                carry / LENGTH_SCALE,
                np.tanh(np.concatenate([reach, carry]) / CLOSE_RANGE),
                obstacles.ravel() / LENGTH_SCALE,
                [self.closure(), self.squeeze(), float(self.grasped), float(self.lifted), setback],
            ]
        ).astype(np.float32)

    def close(self):
        """Free the simulation."""
        self.workspace.close()


def _closure(angle):
    """Finger angle, rad, as 0 open to 1 closed."""
    return float(min(max((OPEN_ANGLE - angle) / (OPEN_ANGLE - CLOSED_ANGLE), 0.0), 1.0))
