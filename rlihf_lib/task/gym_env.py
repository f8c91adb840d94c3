"""The Gymnasium face of the workspace.

robosuite's own `GymWrapper` reports the horizon as `terminated`, so that a learner never bootstraps
at the time limit, and `reset(seed=)` does not seed the placement: hence this adapter.
"""

import math

import gymnasium as gym
import numpy as np

from rlihf_lib.task.contacts import CLEARANCE_RANGE, Contacts
from rlihf_lib.task.control import ARM_DOFS, Controller, StockController
from rlihf_lib.task.moment import LIFTED, Moment, Stages, State
from rlihf_lib.task.path import IdealPath, path_efficiency
from rlihf_lib.task.workspace import OBSTACLES, PLACED_WITHIN, TABLE_HEIGHT, Workspace, closure

LOWERED = 0.03  # metres over the goal from which letting go is placing, not dropping
DOWN = 0.01  # metres off the goal's height up to which the can stands on it
LEANING = math.radians(18)  # up to which a can at the goal may still come to stand when let go
FALLEN = math.radians(60)  # from which a can that nobody holds lies
STANDING = math.radians(5)  # up to which a can that was let go stands
AT_REST = (0.02, 0.3)  # speed (m/s) and spin (rad/s) up to which it is at rest
ALOFT = 0.005  # metres of lift from which a can doesn't stand on the table
IN_HAND = 0.06  # metres between hand and can up to which a can aloft hasn't been dropped
REACHABLE = 0.4  # metres from the table's centre along x or y up to which there is a table
CENTRE = np.array([0, 0, TABLE_HEIGHT + 0.1])  # of the space over the table
# Units of the observation: 0.2 m, 0.5 m/s, and 0.05 m for the hand's goal and for setbacks.
LENGTH_SCALE, SPEED_SCALE, SHORT_SCALE = 0.2, 0.5, 0.05
CLOSE_RANGE = 0.03  # metres; grasping and placing take place at a few centimetres
MOST_SETBACK = 2.0  # of the observation, in its unit
N_OBSERVATIONS = 43


class PickPlaceEnv(gym.Env):
    """Obstacle-avoiding pick-and-place with the Kinova Gen2.

    Action: Box(-1, 1, (4,)): hand displacement along x, y, z (1 = 3 cm), aperture of the hand (-1
    open, 1 closed round a can; beyond +-2/3 fully). Observation: Box(43,), see `_observe`. Reward:
    1 in the step that places the can, else 0; training rewards are made of `info["moment"]`
    (`rlihf_lib.rl.rewards`). `terminated`: the can stands on the goal, or is lost.
    `info["metrics"]` at the end of an episode: `metrics`.

    An episode is truncated after `horizon` steps (paper: 1000), or `patience` steps without getting
    further than ever before in it, as somebody would stop and reset a robot that is stuck. With
    `Workspace(fast=False)` robosuite's own `step` drives the same task, several times slower.
    """

    metadata = {"render_modes": []}  # noqa: RUF012 (Gymnasium's own declaration)

    def __init__(
        self, horizon: int = 1000, patience: int | None = None, workspace: Workspace | None = None
    ):
        self.horizon, self.patience = horizon, patience or horizon
        self.workspace = workspace or Workspace()
        self.controller = (Controller if self.workspace.fast else StockController)(self.workspace)
        self.model, self.data = self.controller.model, self.controller.data
        self.observation_space = gym.spaces.Box(-np.inf, np.inf, (N_OBSERVATIONS,), np.float32)
        self.action_space = gym.spaces.Box(-1.0, 1.0, (4,), np.float32)
        self.contacts = Contacts(self.workspace)
        self._can_body = self.workspace.body_ids["can"]
        self._can_dofs = self.model.joint(self.workspace.objects[0].joints[0]).dofadr[0]
        self._obstacle_bodies = np.array([self.workspace.body_ids[name] for name in OBSTACLES])

    def reset(self, *, seed=None, options=None) -> tuple[np.ndarray, dict]:
        """Start an episode; `seed` seeds this and, through it, all later placements."""
        super().reset(seed=seed)
        if seed is not None:
            self.workspace.reseed(seed)
        self.workspace.reset()
        self.controller.reset()
        self.steps = self.advanced = self.collisions = 0
        self.travelled, self.squared_deviation, self.min_clearance = 0.0, 0.0, CLEARANCE_RANGE
        self.colliding = self.grasped = self.lifted = self.lowered = False
        can = self.body("can")
        self.goal = np.array([*self.workspace.placement["goal"][:2], can[2]])
        self.path, self.stages = IdealPath(self.controller.hand, can, self.goal), Stages(self.goal)
        self.remaining = self.best = self.path.start_remaining
        self.observation = self._observe()
        return self.observation, {}

    def step(self, action) -> tuple[np.ndarray, float, bool, bool, dict]:
        """Advance one control step (Gymnasium API)."""
        before = self.controller.hand.copy()
        self.controller.advance(np.asarray(action, float).clip(-1, 1))
        self.steps += 1
        moved = math.dist(self.controller.hand, before)
        self.travelled += moved
        moment = self._judge(moved)
        self._remember(moment)
        terminated = moment.success or moment.lost
        stuck = self.steps - self.advanced >= self.patience
        truncated = not terminated and (stuck or self.steps >= self.horizon)
        info = {"moment": moment, "is_success": moment.success}
        if terminated or truncated:
            info["metrics"] = self.metrics(moment.success)
        self.observation = self._observe()
        return self.observation, float(moment.success), terminated, truncated, info

    def _judge(self, moved):
        """Tell what the step that has just been made was, as a `Moment`."""
        hand, can = self.controller.hand.copy(), self.body("can")
        tilt = math.acos(min(max(self.data.xmat[self._can_body][8], -1.0), 1.0))
        touch, held_before = self.contacts.touching(), self.grasped
        # Contacts of a can that is carried flicker; only one that leaves the hand is dropped.
        aloft = bool(can[2] > self.goal[2] + ALOFT and math.dist(hand, can) < IN_HAND)
        self.grasped = touch.pinched or (held_before and aloft)
        delivered = self._is_delivered(can, tilt, touch.can)
        success = delivered and not touch.can and tilt < STANDING and self._can_rests()
        off_table = np.abs(can[:2]).max() > REACHABLE or can[2] < TABLE_HEIGHT
        state = State(hand, can, self.grasped, self.squeeze(), delivered)
        remaining = 0.0 if success else self.path.remaining(state)
        return Moment(
            remaining=remaining,
            gained=self.remaining - remaining,
            best=self.best,
            deviation=self.path.deviation(hand),
            clearance=self.contacts.clearance(self.grasped),
            collided=touch.collided,
            grasped=self.grasped,
            success=success,
            lost=bool(off_table or (tilt > FALLEN and not self.grasped)),
            dropped=held_before and not self.grasped and not delivered,
            tilt=tilt,
            nearer=self.stages.nearer(state),
            moved=moved,
        )

    def _is_delivered(self, can, tilt, touched):
        """Whether the can stands on the goal, having been lifted and then set down there."""
        lift, at_goal = can[2] - self.goal[2], math.dist(can[:2], self.goal[:2]) < PLACED_WITHIN
        self.lifted = self.lifted or bool(self.grasped and can[2] > self.goal[2] + LIFTED)
        if self.grasped and touched:  # else the can may be falling past the height asked for
            self.lowered = bool(at_goal and can[2] < self.goal[2] + LOWERED)
        down = abs(lift) < DOWN and tilt < LEANING
        return bool(self.lifted and self.lowered and at_goal and down)

    def _can_rests(self):
        velocity = self.data.qvel[self._can_dofs : self._can_dofs + 6]
        speed, spin = np.linalg.norm(velocity[:3]), np.linalg.norm(velocity[3:])
        return bool(speed < AT_REST[0] and spin < AT_REST[1])

    def _remember(self, moment):
        self.remaining = moment.remaining
        if moment.remaining < self.best:
            self.best, self.advanced = moment.remaining, self.steps
        self.squared_deviation += moment.deviation**2
        self.collisions += moment.collided and not self.colliding
        self.colliding = moment.collided
        self.min_clearance = min(self.min_clearance, moment.clearance)

    def metrics(self, success: bool) -> dict[str, float]:
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

    def body(self, name: str) -> np.ndarray:
        """Centre of the can or of an obstacle, metres, shape (3,)."""
        return self.data.xpos[self.workspace.body_ids[name]].copy()

    def closure(self) -> float:
        """How far the fingers are closed, 0 open to 1 closed."""
        return closure(sum(self.data.qpos[ARM_DOFS : ARM_DOFS + 6 : 2]) / 3)

    def squeeze(self) -> float:
        """How far the fingers are told to close, 0 open to 1 closed."""
        return closure(self.controller.gripper.angle)

    def _observe(self):
        """Everything in units of its own, so that it is about 1 in size."""
        hand, can = self.controller.hand, self.body("can")
        reach, carry = can - hand, self.goal - can
        obstacles = self.data.xpos[self._obstacle_bodies] - hand
        # Progress lost since the best in memory.
        setback = min((self.remaining - self.best) / SHORT_SCALE, MOST_SETBACK)
        entries = (
            (hand - CENTRE) / LENGTH_SCALE,
            self.controller.hand_velocity() / SPEED_SCALE,
            (self.controller.goal_pos - hand) / SHORT_SCALE,
            reach / LENGTH_SCALE,
            self.data.xmat[self._can_body][2:6:3],  # the can's upward axis, x and y
            self.data.cvel[self._can_body][3:] / SPEED_SCALE,
            carry / LENGTH_SCALE,
            np.tanh(np.concatenate([reach, carry]) / CLOSE_RANGE),
            obstacles.ravel() / LENGTH_SCALE,
            [self.closure(), self.squeeze(), float(self.grasped), float(self.lifted), setback],
        )
        return np.concatenate(entries).astype(np.float32)

    def close(self) -> None:
        """Free the simulation."""
        self.workspace.close()
