"""What makes the workspace fast: fitted primitives for collision meshes, objects that sleep."""

import xml.etree.ElementTree as ET
from typing import Any

TIMESTEP = 0.004  # seconds; robosuite's is 0.002
# Fitted to the meshes by MuJoCo's compiler, by how geoms are called (fingertips stay as they are).
OBJECTS = {
    "can": "cylinder",
    "lemon": "ellipsoid",
    "cereal": "box",
    "bottle": "cylinder",
    "bread": "box",
}
ROBOT = {
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


def made_fast(xml: str) -> str:
    """Return a model without meshes that collide, and without what doesn't move anything."""
    root: Any = ET.fromstring(xml)
    for compiler in root.iter("compiler"):
        compiler.attrib |= COMPILER
    option = root.find("option")
    option.attrib |= OPTION
    ET.SubElement(option, "flag", FLAGS)
    _tie_joints_of_fingers(root)
    for geom in root.iter("geom"):
        _simplify(geom, geom.get("name", ""))
    return ET.tostring(root, encoding="unicode")


def _tie_joints_of_fingers(root):
    """Tie the two joints of each finger themselves, not the tendons that couple them one to one.

    MuJoCo can't put objects to sleep yet where tendons are tied.
    """
    equality = root.find("equality")
    for finger in list(equality):
        equality.remove(finger)
        tendon = root.find(f"tendon/fixed[@name='{finger.get('name')}']")
        proximal, distal = (joint.get("joint") for joint in tendon)
        ET.SubElement(equality, "joint", joint1=distal, joint2=proximal)


def _simplify(geom, name):
    """Give a geom its primitive, and contacts that hold what is grasped."""
    if name == "table_collision":
        geom.set("type", "plane")
        geom.set("pos", f"0 0 {geom.get('size').split()[2]}")
    if name.endswith("pad_collision"):
        # 1 mm plates on the fingertips, which touch what they touch: 3 of 9 contacts.
        geom.attrib |= {"contype": "0", "conaffinity": "0"}
    if name.endswith(GRASPING) or name.startswith(tuple(OBJECTS)):
        geom.attrib |= FIRM
    if name.endswith(GRASPING) or name.startswith("lemon"):
        geom.attrib |= ROLLING
    visual = geom.get("contype") == "0" and geom.get("conaffinity") == "0"
    for prefix, primitive in (OBJECTS | ROBOT).items():
        if geom.get("mesh") is not None and not visual and name.startswith(prefix):
            geom.set("type", primitive)
