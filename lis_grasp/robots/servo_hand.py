"""Hand as MJCF with position servos, the actuators of DexGraspBench's hands."""

from __future__ import annotations

from dataclasses import dataclass
from types import MappingProxyType
from xml.etree.ElementTree import Element, SubElement

import numpy as np

from lis_grasp.robots.hand import Hand
from lis_grasp.robots.hand_mjcf import HandMjcf, hand_mjcf, numbers
from lis_grasp.robots.hand_parts import Joint
from lis_grasp.robots.link_tree import by_joint_kind
from lis_grasp.typing import FloatArray

# The own hands of the benchmark have 5 N m/rad. Servos of prismatic joints give 40 N at an error
# of 8 mm, as usual grippers do.
SERVO_STIFFNESS = MappingProxyType({"revolute": 5.0, "prismatic": 5000.0})
"""Stiffness of the servos by kind of joint [N m/rad; N/m]."""
_DAMPING = {"revolute": 0.1, "prismatic": 100.0}  # of the joints [N m s/rad; N s/m]
_PALM = "palm"  # of the bodies that belong to no finger


@dataclass(frozen=True, slots=True, eq=False)
class ServoHand:
    """Elements of a hand with servos; see `HandMjcf`."""

    body_names: dict[str, str]  # by link; the names of a finger's bodies begin with the finger
    parts: HandMjcf
    exclusions: Element  # pairs of bodies that may touch
    actuators: Element


def servo_hand(hand: Hand) -> ServoHand:
    """Return a hand's MJCF elements with position servos, its base link at the identity."""
    fingers = hand.link_fingers
    names = {link: f"{fingers.get(link, _PALM)}_{link}" for link in hand.links}
    parts = hand_mjcf(hand, np.eye(4))
    for body in parts.root.iter("body"):
        body.set("name", names[body.attrib["name"]])
    kinds = {joint.name: joint.kind for joint in hand.joints}
    for element in parts.root.iter("joint"):
        element.set("damping", numbers([_DAMPING[kinds[element.attrib["name"]]]]))
    exclusions = Element("contact")
    for first, second in sorted(hand.self_collision_exclusions):
        SubElement(exclusions, "exclude", {"body1": names[first], "body2": names[second]})
    actuators = Element("actuator")
    for j, joint in enumerate(hand.joint_names):
        limit = hand.effort_limits[j]
        stiffness = numbers([SERVO_STIFFNESS[kinds[joint]]])
        attributes = {"name": joint, "joint": joint, "kp": stiffness}
        SubElement(actuators, "position", attributes | {"forcerange": numbers([-limit, limit])})
    return ServoHand(names, parts, exclusions, actuators)


def moving_joints(hand: Hand) -> list[Joint]:
    """Return the joints that move, followers too, in MuJoCo's order: depth first."""
    children: dict[str, list[Joint]] = {}
    for joint in hand.joints:
        children.setdefault(joint.parent, []).append(joint)
    ordered: list[Joint] = []
    waiting = children.get(hand.base_link, [])[::-1]
    while waiting:
        joint = waiting.pop()
        ordered.append(joint)
        waiting += children.get(joint.child, [])[::-1]
    return [joint for joint in ordered if joint.kind != "fixed"]


def servo_efforts(hand: Hand, efforts: FloatArray) -> FloatArray:
    """Return the errors of the servos (J,) [rad or m] at which they exert efforts (J,)."""
    return np.asarray(efforts / by_joint_kind(hand, **SERVO_STIFFNESS))
