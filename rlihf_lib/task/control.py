"""How an action becomes joint torques, fast.

The same law as robosuite's `OSC_POSE` (operational-space control, Khatib 1987): the hand is pulled
towards a goal pose by a spring of stiffness 150 1/s^2, critically damped, with the full task-space
inertia (`uncouple_pos_ori=False`: without the cross terms turning drags the hand aside by
centimetres), the redundant joint held near its start. What differs is where time goes: torques are
recomputed every 8 ms instead of every 2 ms, and a control step is one loop in compiled code that
calls MuJoCo's C functions.
"""

from typing import NamedTuple

import mujoco
import numba
import numpy as np
from robosuite.utils.transform_utils import mat2quat, quat2axisangle

from rlihf_lib.task.mujoco_c import mj_comPos, mj_fullM, mj_jacSite, mj_kinematics, mj_step

HAND_SITE = "gripper0_right_grip_site"
STIFFNESS = 150.0  # 1/s^2, robosuite's default kp
NULLSPACE_STIFFNESS = 10.0  # 1/s^2
STEP_LENGTH = 0.03  # metres of goal displacement at action 1: 0.3 m/s at 10 Hz
LEASH = 0.10  # metres the goal may run ahead of the hand along an axis; free motion needs 0.06
# The hand's goal stays in this box, metres, as a real arm's workspace limits would keep it.
WORKSPACE_LOW = np.array([-0.31, -0.28, 0.82])
WORKSPACE_HIGH = np.array([0.05, 0.28, 1.08])
ARM_DOFS = 7
TORQUE_PERIOD = 2  # physics steps between two torque computations


class Target(NamedTuple):
    """What the arm is pulled towards."""

    position: np.ndarray
    """Of the hand, metres, (3,)."""
    orientation: np.ndarray
    """Of the hand, (3, 3)."""
    angles: np.ndarray
    """Of the joints, rad, (7,): where the null space returns to."""


class Memory(NamedTuple):
    """Views of the simulation's memory, and room for what is computed from it."""

    ctrl: np.ndarray
    qpos: np.ndarray
    qvel: np.ndarray
    bias: np.ndarray
    inertia: np.ndarray
    hand: np.ndarray
    orientation: np.ndarray
    jacobian: np.ndarray
    mass: np.ndarray


@numba.njit(cache=True)
def _orientation_error(goal, current):
    error = np.zeros(3)
    for k in range(3):
        a, b = current[:, k], goal[:, k]
        error[0] += a[1] * b[2] - a[2] * b[1]
        error[1] += a[2] * b[0] - a[0] * b[2]
        error[2] += a[0] * b[1] - a[1] * b[0]
    return 0.5 * error


@numba.njit(cache=True)
def operational_space_torques(target, hand, orientation, jacobian, mass, bias, q, dq):
    """Joint torques that pull the hand to a goal pose (robosuite's `OSC_POSE`, Khatib 1987).

    Parameters
    ----------
    target : Target
    hand : ndarray, shape (3,)
        Position of the hand, metres.
    orientation : ndarray, shape (3, 3)
        Of the hand.
    jacobian : ndarray, shape (6, 7)
        Of the hand: rows 0-2 translation, 3-5 rotation.
    mass : ndarray, shape (7, 7)
        Joint-space inertia, kg m^2.
    bias : ndarray, shape (7,)
        Gravity and Coriolis torques, N m.
    q, dq : ndarray, shape (7,)
        Joint angles (rad) and velocities (rad/s).

    Returns
    -------
    ndarray, shape (7,)
        Torques, N m.
    """
    damping = 2.0 * np.sqrt(STIFFNESS)
    velocity = jacobian @ dq
    force = STIFFNESS * (target.position - hand) - damping * velocity[:3]
    torque = STIFFNESS * _orientation_error(target.orientation, orientation)
    torque -= damping * velocity[3:]
    pose = NULLSPACE_STIFFNESS * (target.angles - q) - 2.0 * np.sqrt(NULLSPACE_STIFFNESS) * dq
    # The task's acceleration, less what the null-space term would add to it (J M^-1 M pose).
    acceleration = np.concatenate((force, torque)) - jacobian @ pose
    lambda_inv = jacobian @ np.linalg.solve(mass, jacobian.T.copy())
    wrench = np.linalg.solve(lambda_inv, acceleration)
    return jacobian.T @ wrench + mass @ pose + bias


@numba.njit(cache=True)
def _drive(model, data, site, n_steps, target, memory, low, high):
    """Step the physics `n_steps` times, with torques towards the target, from `low` to `high`."""
    jacobian, mass = memory.jacobian, memory.mass
    for step in range(n_steps):
        if step % TORQUE_PERIOD == 0:
            mj_jacSite(model, data, jacobian[:3].ctypes, jacobian[3:].ctypes, site)
            mj_fullM(model, mass.ctypes, memory.inertia.ctypes)
            torques = operational_space_torques(
                target, memory.hand, memory.orientation,
                jacobian[:, :ARM_DOFS].copy(), mass[:ARM_DOFS, :ARM_DOFS].copy(),
                memory.bias[:ARM_DOFS], memory.qpos[:ARM_DOFS], memory.qvel[:ARM_DOFS],
            )  # fmt: skip
            memory.ctrl[:ARM_DOFS] = np.minimum(np.maximum(torques, low), high)
        mj_step(model, data)
    # The last mj_step leaves positions one step ahead of poses: bring them together.
    mj_kinematics(model, data)
    mj_comPos(model, data)


class Controller:
    """Drives a fast `Workspace` one control step at a time.

    Parameters
    ----------
    workspace : Workspace
        Constructed with `fast=True`.

    Attributes
    ----------
    hand : ndarray, shape (3,)
        Position of the grip site, metres: a view of the simulation's memory, which moves on.
    """

    def __init__(self, workspace):
        self.workspace = workspace
        self.model = workspace.sim.model._model
        self.data = workspace.sim.data._data
        self.site = self.model.site(HAND_SITE).id
        self.gripper = workspace.robots[0].gripper["right"]
        self.physics_steps = round(1 / workspace.control_freq / self.model.opt.timestep)
        self.low, self.high = self.model.actuator_ctrlrange[:ARM_DOFS].T.copy()
        finger_range = self.model.actuator_ctrlrange[ARM_DOFS:]
        self.finger_middle = finger_range.mean(axis=1)
        self.finger_half = np.ptp(finger_range, axis=1) / 2
        data, model = self.data, self.model
        self.hand = data.site_xpos[self.site]
        self._memory = Memory(
            data.ctrl, data.qpos, data.qvel, data.qfrc_bias, data.qM,
            self.hand, data.site_xmat[self.site].reshape(3, 3),
            np.zeros((6, model.nv)), np.zeros((model.nv, model.nv)),
        )  # fmt: skip
        self.reset()

    def reset(self):
        """Hold the orientation and the joint angles of the present state from now on."""
        mujoco.mj_forward(self.model, self.data)
        self.goal_ori = self.data.site_xmat[self.site].reshape(3, 3).copy()
        self.q_rest = self.data.qpos[:ARM_DOFS].copy()
        self.goal_pos = self.hand.copy()

    def hand_velocity(self):
        """Velocity of the grip site, metres per second, shape (3,)."""
        velocity = np.zeros(6)
        mujoco.mj_objectVelocity(
            self.model, self.data, mujoco.mjtObj.mjOBJ_SITE, self.site, velocity, 0
        )
        return velocity[3:]

    def move_goal(self, action):
        """Shift the hand's goal by up to 3 cm along each axis, within reach and workspace."""
        hand = self.hand
        ahead = (self.goal_pos + STEP_LENGTH * action[:3] - hand).clip(-LEASH, LEASH)
        self.goal_pos = (hand + ahead).clip(WORKSPACE_LOW, WORKSPACE_HIGH)

    def advance(self, action):
        """Apply one action for one control step.

        Parameters
        ----------
        action : ndarray, shape (4,)
            In [-1, 1]: goal displacement along x, y, z (1 = 3 cm), aperture (-1 open,
            1 closed round a can).
        """
        data = self.data
        self.move_goal(action)
        fingers = self.gripper.format_action(action[3:])
        data.ctrl[ARM_DOFS:] = self.finger_middle + self.finger_half * fingers
        _drive(
            self.model._address, data._address, self.site, self.physics_steps,
            Target(self.goal_pos, self.goal_ori, self.q_rest), self._memory, self.low, self.high,
        )  # fmt: skip


class StockController(Controller):
    """The same interface, driven by robosuite's own `step`: the reference for `Controller`.

    Parameters
    ----------
    workspace : Workspace
        Constructed with `fast=False`.
    """

    def advance(self, action):
        """Apply one action (4,) for one control step, as `Controller.advance` does."""
        orientation = quat2axisangle(mat2quat(self.goal_ori))
        self.move_goal(action)
        self.workspace.step(np.concatenate((self.goal_pos, orientation, action[3:])))
        mujoco.mj_kinematics(self.model, self.data)
        mujoco.mj_comPos(self.model, self.data)
