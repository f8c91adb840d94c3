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
from rlihf_lib.task.workspace import CONTROL_FREQUENCY, Workspace

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
    position: np.ndarray  # of the hand, metres, (3,)
    orientation: np.ndarray  # of the hand, (3, 3)
    angles: np.ndarray  # of the joints, rad, (7,): where the null space returns to


class Arm(NamedTuple):
    """The arm's present state: views of the simulation's memory, but jacobian and mass computed."""

    position: np.ndarray  # of the hand, metres, (3,)
    orientation: np.ndarray  # of the hand, (3, 3)
    angles: np.ndarray  # of the joints, rad, (7,)
    velocities: np.ndarray  # of the joints, rad/s, (7,)
    bias: np.ndarray  # gravity and Coriolis torques, N m, (7,)
    jacobian: np.ndarray  # of the hand, (6, 7): rows 0-2 translation, 3-5 rotation
    mass: np.ndarray  # joint-space inertia, kg m^2, (7, 7)


class Memory(NamedTuple):
    """What a control step works on: views of the simulation's memory, and room for results."""

    arm: Arm
    torques: np.ndarray  # commanded, N m, (7,)
    limits: np.ndarray  # lowest and highest torques, N m, (2, 7)
    inertia: np.ndarray  # as MuJoCo stores it, sparse
    jacobian: np.ndarray  # of all joints, (6, nv)
    mass: np.ndarray  # of all joints, (nv, nv)


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
def _operational_space_torques(target, arm):
    """Joint torques, N m, (7,), that pull the hand of an `Arm` to a `Target`."""
    damping, nullspace_damping = 2.0 * np.sqrt(STIFFNESS), 2.0 * np.sqrt(NULLSPACE_STIFFNESS)
    velocity = arm.jacobian @ arm.velocities
    force = STIFFNESS * (target.position - arm.position) - damping * velocity[:3]
    torque = STIFFNESS * _orientation_error(target.orientation, arm.orientation)
    torque -= damping * velocity[3:]
    pose = NULLSPACE_STIFFNESS * (target.angles - arm.angles) - nullspace_damping * arm.velocities
    # The task's acceleration, less what the null-space term would add to it (J M^-1 M pose).
    acceleration = np.concatenate((force, torque)) - arm.jacobian @ pose
    lambda_inv = arm.jacobian @ np.linalg.solve(arm.mass, arm.jacobian.T.copy())
    wrench = np.linalg.solve(lambda_inv, acceleration)
    return arm.jacobian.T @ wrench + arm.mass @ pose + arm.bias


@numba.njit(cache=True)
def _drive(model, data, site, n_steps, target, memory):
    """Step the physics `n_steps` times, with torques that pull the hand at `site` to the target."""
    jacobian, mass, limits = memory.jacobian, memory.mass, memory.limits
    for step in range(n_steps):
        if step % TORQUE_PERIOD == 0:
            mj_jacSite(model, data, jacobian[:3].ctypes, jacobian[3:].ctypes, site)
            mj_fullM(model, mass.ctypes, memory.inertia.ctypes)
            memory.arm.jacobian[:] = jacobian[:, :ARM_DOFS]
            memory.arm.mass[:] = mass[:ARM_DOFS, :ARM_DOFS]
            torques = _operational_space_torques(target, memory.arm)
            memory.torques[:] = np.minimum(np.maximum(torques, limits[0]), limits[1])
        mj_step(model, data)
    # The last mj_step leaves positions one step ahead of poses: bring them together.
    mj_kinematics(model, data)
    mj_comPos(model, data)


class Controller:
    """Drives a fast `Workspace` one control step at a time.

    `hand` is the position of the grip site, metres, (3,), a view of the simulation's memory, which
    moves on; `goal_pos` is where it is pulled to.
    """

    def __init__(self, workspace: Workspace):
        self.workspace = workspace
        model = self.model = workspace.sim.model._model
        data = self.data = workspace.sim.data._data
        self.site = model.site("gripper0_right_grip_site").id
        self.gripper = workspace.robots[0].gripper["right"]
        self.physics_steps = round(1 / CONTROL_FREQUENCY / model.opt.timestep)
        arm_range, finger_range = np.split(model.actuator_ctrlrange, [ARM_DOFS])
        self.finger_middle = finger_range.mean(axis=1)
        self.finger_half = np.ptp(finger_range, axis=1) / 2
        self.hand = data.site_xpos[self.site]
        self._orientation = data.site_xmat[self.site].reshape(3, 3)
        arm = Arm(
            self.hand, self._orientation,
            data.qpos[:ARM_DOFS], data.qvel[:ARM_DOFS], data.qfrc_bias[:ARM_DOFS],
            np.zeros((6, ARM_DOFS)), np.zeros((ARM_DOFS, ARM_DOFS)),
        )  # fmt: skip
        self._memory = Memory(
            arm, data.ctrl[:ARM_DOFS], arm_range.T.copy(), data.qM,
            np.zeros((6, model.nv)), np.zeros((model.nv, model.nv)),
        )  # fmt: skip
        self.reset()

    def reset(self) -> None:
        """Hold the orientation and the joint angles of the present state from now on."""
        mujoco.mj_forward(self.model, self.data)
        self.goal_ori = self._orientation.copy()
        self.q_rest = self.data.qpos[:ARM_DOFS].copy()
        self.goal_pos = self.hand.copy()

    def hand_velocity(self) -> np.ndarray:
        """Velocity of the grip site, metres per second, shape (3,)."""
        velocity, kind = np.zeros(6), mujoco.mjtObj.mjOBJ_SITE
        mujoco.mj_objectVelocity(self.model, self.data, kind, self.site, velocity, 0)
        return velocity[3:]

    def move_goal(self, action: np.ndarray) -> None:
        """Shift the hand's goal by up to 3 cm along each axis, within reach and workspace."""
        ahead = (self.goal_pos + STEP_LENGTH * action[:3] - self.hand).clip(-LEASH, LEASH)
        self.goal_pos = (self.hand + ahead).clip(WORKSPACE_LOW, WORKSPACE_HIGH)

    def advance(self, action: np.ndarray) -> None:
        """Apply one action, (4,), as of `gym_env.PickPlaceEnv`, for one control step."""
        self.move_goal(action)
        fingers = self.gripper.format_action(action[3:])
        self.data.ctrl[ARM_DOFS:] = self.finger_middle + self.finger_half * fingers
        target = Target(self.goal_pos, self.goal_ori, self.q_rest)
        addresses = self.model._address, self.data._address
        _drive(*addresses, self.site, self.physics_steps, target, self._memory)


class StockController(Controller):
    """The reference for `Controller`: drives `Workspace(fast=False)` by robosuite's own `step`."""

    def advance(self, action: np.ndarray) -> None:
        """Apply one action for one control step."""
        orientation = quat2axisangle(mat2quat(self.goal_ori))
        self.move_goal(action)
        self.workspace.step(np.concatenate((self.goal_pos, orientation, action[3:])))
        mujoco.mj_kinematics(self.model, self.data)
        mujoco.mj_comPos(self.model, self.data)
