"""The robosuite environment: Lift made into pick-and-place among obstacles (paper, Fig. 3).

A Kinova Gen2 (robosuite's `Jaco`) stands before a table with a red can, a lemon, a cereal box, a
green bottle and bread. The can must be placed upright on the goal, a gray cylinder on the right,
without touching the four obstacles. Coordinates are metres in robosuite's world frame: x away from
the robot, y to the right as seen by a person facing the robot, z up, the table's top at z = 0.8.
"""

import copy
import xml.etree.ElementTree as ET
from typing import Any

import mujoco
import numpy as np
from robosuite.controllers import load_composite_controller_config
from robosuite.environments.manipulation.manipulation_env import ManipulationEnv
from robosuite.models import objects
from robosuite.models.arenas import TableArena
from robosuite.models.grippers import register_gripper
from robosuite.models.grippers.jaco_three_finger_gripper import JacoThreeFingerGripperBase
from robosuite.models.tasks import ManipulationTask

CONTROL_FREQUENCY = 10  # control steps per second
TABLE_SIZE, TABLE_HEIGHT = (0.8, 0.8, 0.05), 0.8  # metres
# With the primitives that, when fast, MuJoCo's compiler fits to their meshes; so below.
OBJECTS = {
    "can": (objects.CanObject, "cylinder"),
    "lemon": (objects.LemonObject, "ellipsoid"),
    "cereal": (objects.CerealObject, "box"),
    "bottle": (objects.BottleObject, "cylinder"),
    "bread": (objects.BreadObject, "box"),
}
OBSTACLES = ("lemon", "cereal", "bottle", "bread")
GOAL_SIZE = (0.045, 0.004)  # radius and half the height of the goal's mark, metres
PLACED_WITHIN = 0.04  # metres between the can's and the goal's centre
# Nominal places on the table (x, y) and half-widths of the uniform jitter, metres. The cereal box
# and the bottle block the straight way from can to goal; lemon and bread stand beside the ends.
PLACES = {
    "can": ((-0.07, -0.20), 0.03),
    "goal": ((-0.07, 0.20), 0.02),
    "lemon": ((0.06, -0.12), 0.015),
    "cereal": ((0.00, 0.00), 0.01),
    "bottle": ((-0.10, 0.00), 0.01),
    "bread": ((0.06, 0.14), 0.015),
}
# Finger joints: 1.2 rad is open; 0.6 rad is closed round a can. Commanded to 0, the fingers creep
# on round the can and throw it over when they open; so they do when they open at once.
OPEN_ANGLE, CLOSED_ANGLE, FINGER_RANGE = 1.2, 0.6, 1.51
FINGER_STEP = 0.15  # rad per control step: 1.5 rad/s at 10 Hz
APERTURE_GAIN = 0.75  # closure per unit of the command: beyond +-2/3 the hand is open or closed
START_TURN = 0.35  # rad of the arm's first joint away from robosuite's start, towards the can

# What makes the workspace fast: fitted primitives for collision meshes, by how geoms are called
# (fingertips stay as they are), a longer step, objects that sleep.
TIMESTEP = 0.004  # seconds; robosuite's is 0.002
PRIMITIVES = {name: primitive for name, (_, primitive) in OBJECTS.items()} | {
    "robot0": "capsule",
    "gripper0_right_hand": "cylinder",
    "gripper0_right_thumb": "capsule",
    "gripper0_right_index": "capsule",
    "gripper0_right_pinky": "capsule",
}
GRASPING = ("tip_collision", "distal_collision")
# Robosuite's contacts (can: 1 ms, fingertips underdamped) squeeze the can out of the hand at a 4 ms
# step (0-2 of 12 grasps hold); 12 ms, overdamped and 5 mm wide hold it in 24 of 24.
FIRM = {"solref": "0.012 2", "solimp": "0.9 0.95 0.005"}
# Rolling friction, which the models state and condim 4 leaves out: without it the lemon never comes
# to rest. The can stays at 4, or one that leans on its edge stays leaning.
ROLLING = {"condim": "6"}
# Else primitives come out at 85 % of the meshes' size; and there is nothing to be seen.
COMPILER = {"fitaabb": "true", "discardvisual": "true"}
# Objects at rest (slower than 1 mm/s) sleep until touched. Contacts by libccd take half as long.
OPTION = {"sleep_tolerance": "1e-3", "ccd_tolerance": "1e-5"}
FLAGS = {"sleep": "enable", "nativeccd": "disable", "sensor": "disable"}


def closure(angle: float) -> float:
    """Finger angle, rad, as 0 open to 1 closed."""
    return float(min(max((OPEN_ANGLE - angle) / (OPEN_ANGLE - CLOSED_ANGLE), 0.0), 1.0))


@register_gripper
class JacoApertureGripper(JacoThreeFingerGripperBase):
    """Jaco's hand with one command, the aperture wanted: -1 open to 1 closed round a can.

    Beyond +-2/3 the hand is fully open or closed: a squashed Gaussian hardly reaches +-1, and a
    hand closed less than fully lets the can slip. robosuite's own one-action version integrates
    +-0.01 a step, so that random actions never close the hand.
    """

    init_qpos = np.tile([OPEN_ANGLE, OPEN_ANGLE / 2], 3)  # finger joints at the start, rad: open
    dof = 1  # commands, for three fingers

    def format_action(self, action: np.ndarray) -> np.ndarray:
        """Turn one command in [-1, 1] into the three finger actuators' commands."""
        closed = min(max(0.5 + APERTURE_GAIN * action[0], 0.0), 1.0)
        target = OPEN_ANGLE + closed * (CLOSED_ANGLE - OPEN_ANGLE)
        self.angle += min(max(target - self.angle, -FINGER_STEP), FINGER_STEP)
        self.current_action = np.full(3, 2 * self.angle / FINGER_RANGE - 1)
        return self.current_action

    def open(self) -> None:
        """Command the hand open at once, as at the start of an episode."""
        self.angle = OPEN_ANGLE


class Workspace(ManipulationEnv):
    """Pick-and-place among obstacles as a robosuite environment.

    If `fast`, collision shapes are primitives and the physics step is longer, to be driven by
    `rlihf_lib.task.control`; else robosuite's meshes, timestep and `step` are unchanged, the
    reference for speed and for correctness.
    """

    reward_scale = 1.0  # robosuite's GymWrapper asks for it

    def __init__(self, fast: bool = True):
        self.fast = fast
        self.reseed(0)
        controller = load_composite_controller_config(controller="BASIC", robot="Jaco")
        arm = controller["body_parts"]["right"]
        arm.update(input_type="absolute", input_ref_frame="world", uncouple_pos_ori=False)
        super().__init__(
            robots="Jaco", gripper_types="JacoApertureGripper", controller_configs=controller,
            control_freq=CONTROL_FREQUENCY, initialization_noise=None, ignore_done=True,
            hard_reset=False, has_renderer=False, has_offscreen_renderer=False,
            use_camera_obs=False,
        )  # fmt: skip

    def _load_model(self):
        super()._load_model()
        robot = self.robots[0].robot_model
        robot.set_base_xpos(robot.base_xpos_offset["table"](TABLE_SIZE[0]))
        self.robots[0].init_qpos[0] += START_TURN
        arena = TableArena(table_full_size=TABLE_SIZE, table_offset=(0, 0, TABLE_HEIGHT))
        arena.set_origin([0, 0, 0])
        self.objects = [make(name) for name, (make, _) in OBJECTS.items()]
        # The goal is a mark, not an obstacle: visible, without contacts, not moved by physics.
        self.goal = objects.CylinderObject(
            "goal", size=[*GOAL_SIZE], rgba=[0.5, 0.5, 0.5, 1], joints=None, obj_type="visual"
        )
        self.model = _Task(arena, [robot], [*self.objects, self.goal])

    def _initialize_sim(self, xml_string=None):
        if self.fast and xml_string is None:
            xml_string = made_fast(self.model.get_xml())
        super()._initialize_sim(xml_string)
        if self.fast:
            self.sim.model._model.opt.timestep = self.model_timestep = TIMESTEP

    def _setup_references(self):
        super()._setup_references()
        model = self.sim.model._model
        self.body_ids = {o.name: model.body(o.root_body).id for o in [*self.objects, self.goal]}
        self.qpos_address = {o.name: model.joint(o.joints[0]).qposadr[0] for o in self.objects}
        self.solid = (model.geom_contype > 0) | (model.geom_conaffinity > 0)
        self.geom_ids = {
            name: np.flatnonzero(self.solid & (model.geom_bodyid == body))
            for name, body in self.body_ids.items()
        }

    def reset(self) -> dict | None:
        """Start an episode with new places of can, goal and obstacles."""
        if not self.fast:
            return super().reset()
        # Back to what robosuite's own reset, which takes ten times as long, left before the objects
        # were placed: the robot starts every episode alike.
        mujoco.mj_copyData(self.sim.data._data, self.sim.model._model, self._start)
        self._place()
        self.sim.forward()
        return None

    def _reset_internal(self):
        super()._reset_internal()
        if self.fast:
            self._start = copy.copy(self.sim.data._data)
        self._place()

    def _place(self):
        """Open the hand and draw the places of can, goal and obstacles."""
        self.robots[0].gripper["right"].open()
        model, data = self.sim.model._model, self.sim.data._data
        data.qpos += 0.0  # robosuite's noise of no size leaves -0 as often as 0
        self.placement = {}
        for name, (place, jitter) in PLACES.items():
            xy = place + self._placement_rng.uniform(-jitter, jitter, 2)
            height = GOAL_SIZE[1] if name == "goal" else self._standing_height(name)
            where = self.placement[name] = np.array([*xy, TABLE_HEIGHT + height])
            if name == "goal":
                model.body_pos[self.body_ids[name]] = where
            else:
                address = self.qpos_address[name]
                data.qpos[address : address + 7] = [*where, 1, 0, 0, 0]

    def _standing_height(self, name):
        """Height of an object's centre over what it stands on, metres."""
        model = self.sim.model._model
        geom = self.geom_ids[name][0]
        (centre, half), rotation = model.geom_aabb[geom].reshape(2, 3), np.zeros(9)
        mujoco.mju_quat2Mat(rotation, model.geom_quat[geom])
        rotation = rotation.reshape(3, 3)
        middle = model.geom_pos[geom] + rotation @ centre
        return float((np.abs(rotation) @ half)[2] - middle[2])

    def reseed(self, seed: int) -> None:
        """Start the placements of this environment anew from `seed`."""
        self._placement_rng = np.random.default_rng(seed)

    def reward(self, action=None) -> float:
        """Sparse reward: 1 in the step that finds the can placed, else 0."""
        return float(self._check_success())

    def _check_success(self):
        can = self.sim.data.body_xpos[self.body_ids["can"]]
        return bool(np.linalg.norm(can[:2] - self.placement["goal"][:2]) < PLACED_WITHIN)


def made_fast(xml: str) -> str:
    """Return a model without meshes that collide, and without what doesn't move anything."""
    root: Any = ET.fromstring(xml)
    for compiler in root.iter("compiler"):
        compiler.attrib |= COMPILER
    option = root.find("option")
    option.attrib |= OPTION
    ET.SubElement(option, "flag", FLAGS)
    # MuJoCo can't put objects to sleep yet where tendons are tied: instead of those that couple the
    # two joints of each finger one to one, tie the joints themselves.
    equality = root.find("equality")
    for finger in list(equality):
        equality.remove(finger)
        tendon = root.find(f"tendon/fixed[@name='{finger.get('name')}']")
        proximal, distal = (joint.get("joint") for joint in tendon)
        ET.SubElement(equality, "joint", joint1=distal, joint2=proximal)
    for geom in root.iter("geom"):
        name = geom.get("name", "")
        if name == "table_collision":
            geom.attrib |= {"type": "plane", "pos": f"0 0 {geom.get('size').split()[2]}"}
        if name.endswith("pad_collision"):
            # 1 mm plates on the fingertips, which touch what they touch: 3 of 9 contacts.
            geom.attrib |= {"contype": "0", "conaffinity": "0"}
        if name.endswith(GRASPING) or name.startswith(tuple(OBJECTS)):
            geom.attrib |= FIRM
        if name.endswith(GRASPING) or name.startswith("lemon"):
            geom.attrib |= ROLLING
        visual = geom.get("contype") == geom.get("conaffinity") == "0"
        for prefix, primitive in PRIMITIVES.items():
            if geom.get("mesh") is not None and not visual and name.startswith(prefix):
                geom.set("type", primitive)
    return ET.tostring(root, encoding="unicode")


class _Task(ManipulationTask):
    def generate_id_mappings(self, sim):
        """Names of geoms in segmented images, visual ones included, which a fast model hasn't."""
