"""Hand as MJCF, MuJoCo's description format, and the position servos of DexGraspBench's hands."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from types import MappingProxyType
from xml.etree.ElementTree import Element, SubElement

import numpy as np
import numpy.typing as npt
from scipy.spatial.transform import Rotation

from lis_grasp.geometry import as_pose
from lis_grasp.robots.hand import Hand
from lis_grasp.robots.inertias import LEAST_MASS, small_ball
from lis_grasp.robots.robot_model import Inertial, Joint, LinkGeometry, by_joint_kind
from lis_grasp.typing import FloatArray

# With MuJoCo's default, coupled joints of a squeezing hand are off by 2 degrees, and the grip is a
# tenth weaker; with a time constant of 2 ms [s] they chatter, and held objects creep.
_COUPLING = {"solref": "0.005 1", "solimp": "0.999 0.9999 0.0001 0.5 2"}

# The own hands of the benchmark have 5 N m/rad. Servos of prismatic joints give 40 N at an error
# of 8 mm, as usual grippers do.
SERVO_STIFFNESS = MappingProxyType({"revolute": 5.0, "prismatic": 5000.0})
"""Stiffness of the servos by kind of joint [N m/rad; N/m]."""
_DAMPING = {"revolute": 0.1, "prismatic": 100.0}  # of the joints [N m s/rad; N s/m]
_PALM = "palm"  # of the bodies that belong to no finger


@dataclass(frozen=True, slots=True, eq=False)
class HandMjcf:
    """Elements of a hand for an MJCF file; lengths in metres, angles in radians."""

    root: Element  # the base link's body, which contains the bodies of all other links
    meshes: list[Element]  # assets of the collision bodies, their vertices included
    couplings: list[Element]  # equality constraints of the joints that follow another


def hand_mjcf(
    hand: Hand, X_WL: npt.ArrayLike, *, prefix: str = "", geom: Mapping[str, str] | None = None
) -> HandMjcf:
    """Return a hand's links, joints and collision bodies as MJCF elements.

    They are written from the hand's own tree, not read from its URDF by MuJoCo: so they have the
    repairs and edits of its YAML, its coupled joints, and the convex bodies that planning uses.
    Gravity is compensated. Joints have no actuators, damping or friction.

    Parameters
    ----------
    hand
        The hand.
    X_WL
        Shape (4, 4): pose of the base link in the body that it will be part of.
    prefix
        Put before the names of links and joints.
    geom
        Attributes of all collision bodies, as contact parameters.
    """
    bodies = {hand.base_link: _body(hand, hand.base_link, as_pose(X_WL), prefix)}
    couplings = []
    for joint in hand.joints:
        body = _body(hand, joint.child, joint.X_PJ, prefix)
        bodies[joint.parent].append(body)
        bodies[joint.child] = body
        if joint.kind != "fixed":
            body.insert(1, _joint(hand, joint, prefix))
        if joint.follows:
            leader = prefix + hand.joint_names[joint.index]
            linear = numbers([joint.offset, joint.multiplier, 0.0, 0.0, 0.0])
            ends = {"joint1": prefix + joint.name, "joint2": leader, "polycoef": linear}
            couplings.append(Element("joint", ends | _COUPLING))
    meshes = []
    for number, geometry in enumerate(hand.link_geometries):
        name = f"{prefix}{geometry.link}_{number}"
        element = SubElement(bodies[geometry.link], "geom", {"name": name, **(geom or {})})
        element.attrib |= shape_attributes(geometry, name)
        if geometry.kind == "mesh":
            meshes.append(mesh_asset(name, geometry.mesh.vertices))
    return HandMjcf(bodies[hand.base_link], meshes, couplings)


def mesh_asset(name: str, vertices: FloatArray) -> Element:
    """Return the asset of a convex mesh: the hull of vertices (V, 3) [m]."""
    return Element("mesh", {"name": name, "vertex": numbers(vertices), "inertia": "convex"})


def numbers(values: npt.ArrayLike) -> str:
    """Return numbers as an attribute of XML, with all digits."""
    return " ".join(map(repr, np.ravel(np.asarray(values, np.float64)).tolist()))


def pose(X: FloatArray) -> dict[str, str]:
    """Return a pose (4, 4) as the attributes ``pos`` and ``quat``."""
    quaternion = Rotation.from_matrix(X[:3, :3]).as_quat(scalar_first=True)
    return {"pos": numbers(X[:3, 3]), "quat": numbers(quaternion)}


def inertial(mass: float, center: FloatArray, matrix: FloatArray) -> Element:
    """Return a mass [kg] at a centre (3,) [m] with its inertia (3, 3) [kg m^2] about it."""
    moments = matrix[[0, 1, 2, 0, 0, 1], [0, 1, 2, 1, 2, 2]]
    attributes = {"pos": numbers(center), "mass": numbers(mass), "fullinertia": numbers(moments)}
    return Element("inertial", attributes)


def _body(hand: Hand, link: str, X: FloatArray, prefix: str) -> Element:
    body = Element("body", {"name": prefix + link, **pose(X), "gravcomp": "1"})
    given = hand.inertials.get(link)
    if given is None or given.mass < LEAST_MASS:
        given = Inertial(LEAST_MASS, np.zeros(3), small_ball(LEAST_MASS))  # as in Drake
    body.append(inertial(given.mass, given.center_L, given.inertia_L))
    return body


def _joint(hand: Hand, joint: Joint, prefix: str) -> Element:
    kind = {"revolute": "hinge", "prismatic": "slide"}[joint.kind]
    attributes = {"name": prefix + joint.name, "type": kind, "axis": numbers(joint.axis_J)}
    limits = hand.lower[joint.index], hand.upper[joint.index]
    if not joint.follows and np.isfinite(limits).all():
        attributes["range"] = numbers(limits)
    return Element("joint", attributes)


def shape_attributes(geometry: LinkGeometry, name: str) -> dict[str, str]:
    """Return kind, size and pose of a geometry; a mesh is the asset of a name."""
    placed = pose(geometry.X_LG)
    if geometry.kind == "mesh":
        return {"type": "mesh", "mesh": name, **placed}
    # MuJoCo gives half of a box's sides, and of the length of a cylinder or capsule.
    parts = {"box": [0.5, 0.5, 0.5], "sphere": [1.0]}.get(geometry.kind, [1.0, 0.5])
    half = np.array(geometry.dimensions) * parts
    return {"type": geometry.kind, "size": numbers(half), **placed}


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

    def below(link: str) -> Iterator[Joint]:
        for joint in (joint for joint in hand.joints if joint.parent == link):
            yield joint
            yield from below(joint.child)

    return [joint for joint in below(hand.base_link) if joint.kind != "fixed"]


def servo_efforts(hand: Hand, efforts: FloatArray) -> FloatArray:
    """Return the errors of the servos (J,) [rad or m] at which they exert efforts (J,)."""
    return np.asarray(efforts / by_joint_kind(hand, **SERVO_STIFFNESS))
