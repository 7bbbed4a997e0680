"""MJCF of a lift: a free object of convex pieces on a table, and a hand on a wrist."""

from __future__ import annotations

from collections.abc import Sequence
from xml.etree import ElementTree
from xml.etree.ElementTree import Element, SubElement

import numpy as np
import trimesh

from lis_grasp.geometry import make_pose, rotate
from lis_grasp.lifting.setup import (
    WRIST_DAMPING,
    WRIST_LIMITS,
    WRIST_STIFFNESS,
    LiftSetup,
    finger_gains,
)
from lis_grasp.motion import OBJECT
from lis_grasp.robots.mjcf import hand_mjcf, inertial, mesh_asset, numbers, pose
from lis_grasp.shapes.object_mass import uniform_inertia
from lis_grasp.simulation.mujoco._beside import add_beside
from lis_grasp.typing import FloatArray

HAND = "hand/"
"""Put before the names of the hand's links and joints."""
WRIST_JOINTS = tuple(f"wrist_{kind}_{axis}" for kind in ("slide", "turn") for axis in "xyz")
"""The wrist's joints: x, y, z, roll, pitch, yaw."""

TIME_STEP = 0.0005
"""Largest time step of MuJoCo [s]."""

# A time constant of four time steps: 5 N press a fingertip in by 0.04 mm. Softer contacts let
# objects creep in the hand while it shakes; with two time steps, forces chatter.
_CONTACT = {"solref": "0.002 1", "solimp": "0.9 0.99 0.0001 0.5 2"}
# A tip of 12 mm radius, pressed in by 0.4 mm, has a patch of 3.1 mm radius with pressure by depth:
# friction resists turning at 0.53 of that radius [m].
_TORSION_ARM = 0.0017
# Ratio of the stiffness of friction to that of the normal force. At MuJoCo's default of 1, objects
# creep out of the hand within seconds. At 100 a screwdriver between two flat pads still turns by
# 1.2 deg/s, far below the limit of friction; at 1000 by 0.4 deg/s; above, nothing changes.
_FRICTION_STIFFNESS = 1000.0
_COLLIDES = {  # bits of a body, and of those that it meets: never hand and hand
    "hand": {"contype": "1", "conaffinity": "0"},
    "object": {"contype": "2", "conaffinity": "1"},
    "table": {"contype": "0", "conaffinity": "3"},
    "fixed": {"contype": "0", "conaffinity": "7"},
    "free": {"contype": "4", "conaffinity": "7"},
}
# A carriage of the wrist, as in Drake: a ball of this mass [kg] and inertia [kg m^2].
_CARRIAGE = inertial(0.1, np.zeros(3), 1e-4 * np.eye(3))


def scene_mjcf(setup: LiftSetup, pieces: Sequence[trimesh.Trimesh]) -> str:
    """Return the MJCF of a lift, whose object collides as convex pieces in O [m].

    The object's body has its frame in the centre of mass, along O's axes. The wrist's zero is the
    palm pose of the grasp. The actuators move `WRIST_JOINTS`, then the hand's joints.
    """
    root = Element("mujoco", {"model": "lift"})
    SubElement(root, "compiler", {"angle": "radian", "autolimits": "true"})
    option = SubElement(root, "option", {"timestep": numbers(TIME_STEP)})
    option.attrib |= {"integrator": "implicitfast", "cone": "elliptic"}
    option.attrib["impratio"] = numbers(_FRICTION_STIFFNESS)
    SubElement(option, "flag", {"autoreset": "disable", "multiccd": "enable"})
    assets = SubElement(root, "asset")
    world = SubElement(root, "worldbody")
    world.append(_table(setup))
    assets.extend(mesh_asset(f"piece_{k}", piece.vertices) for k, piece in enumerate(pieces))
    world.append(_object(setup, len(pieces)))
    for body in setup.surroundings:
        kind = "fixed" if body.is_fixed else "free"
        add_beside(world, assets, body, _contact(body.friction) | _COLLIDES[kind])
    X_WB = setup.X_WB
    wrist, last = _wrist(X_WB[:3, 3])
    world.append(wrist)
    contact = _contact(setup.friction) | _COLLIDES["hand"]
    hand = hand_mjcf(setup.hand, make_pose(X_WB[:3, :3]), prefix=HAND, geom=contact)
    last.append(hand.root)
    assets.extend(hand.meshes)
    SubElement(root, "equality").extend(hand.couplings)
    root.append(_actuators(setup))
    return ElementTree.tostring(root, encoding="unicode")


def _contact(friction: float) -> dict[str, str]:
    coefficients = numbers([friction, _TORSION_ARM * friction, 0.0])
    return {**_CONTACT, "condim": "4", "friction": coefficients}


def _table(setup: LiftSetup) -> Element:
    place = numbers([0.0, 0.0, setup.support_height])
    attributes = {"name": "table", "type": "plane", "size": "0 0 1", "pos": place}
    kind = "fixed" if len(setup.surroundings) else "table"  # which carries free bodies, too
    return Element("geom", attributes | _contact(setup.friction) | _COLLIDES[kind])


def _object(setup: LiftSetup, pieces: int) -> Element:
    mesh = setup.mesh
    center = np.asarray(mesh.center_mass)
    X_WB = np.array(setup.X_WO, dtype=np.float64)
    X_WB[:3, 3] += rotate(X_WB, center)
    body = Element("body", {"name": OBJECT, **pose(X_WB)})
    SubElement(body, "freejoint", {"name": OBJECT})
    body.append(inertial(setup.mass, np.zeros(3), uniform_inertia(mesh, setup.mass)))
    shape = {"type": "mesh", "pos": numbers(-center)}
    for k in range(pieces):
        geom = SubElement(body, "geom", {"name": f"piece_{k}", "mesh": f"piece_{k}", **shape})
        geom.attrib |= _contact(setup.friction) | _COLLIDES["object"]
    return body


def _wrist(place: FloatArray) -> tuple[Element, Element]:
    """Return the first and the last of the six bodies between the world and the hand."""
    # Yaw first, roll last: the usual roll-pitch-yaw about W's axes.
    axes = dict(zip(WRIST_JOINTS, np.vstack([np.eye(3), np.eye(3)]), strict=True))
    order = (*WRIST_JOINTS[:3], *reversed(WRIST_JOINTS[3:]))
    bodies: list[Element] = []
    for name in order:
        body = Element("body", {"name": f"{name}_body", "gravcomp": "1"})
        body.append(_CARRIAGE)
        kind = "slide" if name in WRIST_JOINTS[:3] else "hinge"
        SubElement(body, "joint", {"name": name, "type": kind, "axis": numbers(axes[name])})
        if bodies:
            bodies[-1].append(body)
        bodies.append(body)
    bodies[0].set("pos", numbers(place))
    return bodies[0], bodies[-1]


def _actuators(setup: LiftSetup) -> Element:
    actuators = Element("actuator")
    for number, name in enumerate(WRIST_JOINTS):
        turning = number >= 3
        gains = WRIST_STIFFNESS[turning], WRIST_DAMPING[turning], WRIST_LIMITS[turning]
        actuators.append(_servo(name, *gains))
    stiffness, damping = finger_gains(setup.hand, setup.grasp)
    for j, name in enumerate(setup.hand.joint_names):
        limit = setup.hand.effort_limits[j]
        actuators.append(_servo(HAND + name, stiffness[j], damping[j], limit))
    return actuators


def _servo(joint: str, stiffness: float, damping: float, limit: float) -> Element:
    """Return an actuator of effort ``stiffness (ctrl - q) - damping q'``, limited."""
    attributes = {"name": joint, "joint": joint, "kp": numbers(stiffness), "kv": numbers(damping)}
    return Element("position", attributes | {"forcerange": numbers([-limit, limit])})
