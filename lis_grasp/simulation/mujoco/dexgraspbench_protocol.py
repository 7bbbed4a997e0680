"""DexGraspBench's protocol in MuJoCo: a lift off the table, and forces from six directions."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from xml.etree import ElementTree
from xml.etree.ElementTree import Element, SubElement

import mujoco
import numpy as np
import trimesh
from scipy.spatial.transform import Rotation, Slerp

from lis_grasp.grasping.export import ServoPostures, servo_postures
from lis_grasp.grasping.grasps import Grasp
from lis_grasp.motion import OBJECT
from lis_grasp.robots.hand import Hand
from lis_grasp.robots.mjcf import mesh_asset, moving_joints, numbers, servo_hand
from lis_grasp.typing import FloatArray

MASS = 0.1
"""Of the object [kg]."""
FRICTION = 0.6
"""Coulomb's coefficient of all contacts."""
TORSION = 0.02
"""Torsional coefficient of all contacts [m]."""

_ACCELERATION = 10.0  # of the table lift's gravity and of the six forces [m/s^2]
_TIME_STEP = 0.004  # [s]
_STEPS = 10  # commands from one posture to the next, and time steps for each command
_WAIT = (10, 50)  # checks under a force, and time steps between them
_RISE = 0.1  # [m]
_LARGEST_MOTION = 0.05  # of the object [m]
_LARGEST_TURN = np.deg2rad(15.0)  # of the object
_LARGEST_PENETRATION = 0.01  # of the opened hand [m]
_HAND_CONTACT = {"solimp": "0.5 0.99 0.0001 0.5 2", "solref": "0.005 1"}
_FRICTION = {"friction": numbers([FRICTION, TORSION, 0.0001]), "condim": "4"}
_BASE, _CARRIER = "base", "carrier"


@dataclass(frozen=True, slots=True)
class ProtocolOutcome:
    """Whether a grasp passes: the object moves less than 5 cm and turns less than 15 degrees."""

    table_lift: bool  #: relative to the hand's rise of 10 cm
    force_test: bool  #: under a force of 10 m/s^2 times the mass along each of six directions


def dexgraspbench_protocol(
    hand: Hand, grasp: Grasp, pieces: Sequence[trimesh.Trimesh], support_height: float
) -> ProtocolOutcome:
    """Execute a grasp by the protocol of DexGraspBench (Chen, Ke and Wang, BODex, ICRA 2025).

    The hand's base follows a moving frame, its joints are position servos that run open loop from
    the pregrasp to the planned posture and to the squeeze (`servo_postures`). Object: 0.1 kg,
    friction 0.6 (torsional 0.02 m), without gravity but for the table lift. Facts of the protocol
    are taken from the benchmark's main branch; it has no control by contact and no shake.

    Parameters
    ----------
    hand, grasp
        The hand, and its grasp in O.
    pieces
        The object's convex pieces in O [m], by `convex_pieces`.
    support_height
        Height of the table in O [m].
    """
    postures = servo_postures(hand, grasp, support_height)
    lift = _Bench(hand, pieces, support_height, table=True)
    lift.reset(postures)
    passed = lift.penetration() <= _LARGEST_PENETRATION
    if passed:
        lift.push(np.array([0.0, 0.0, -1.0]))
        lift.close(postures)
        risen = postures.squeeze.copy()
        risen[2] += _RISE
        lift.move(postures.squeeze, risen)
        passed = lift.is_in_place(np.array([0.0, 0.0, _RISE]))
    force = _Bench(hand, pieces, support_height, table=False)
    force.reset(postures)
    clear = force.penetration() <= _LARGEST_PENETRATION
    directions = np.vstack([np.eye(3), -np.eye(3)])
    held = clear and all(force.holds_against(postures, direction) for direction in directions)
    return ProtocolOutcome(passed, held)


class _Bench:
    """The benchmark's scene: a hand of servos on a moving frame, a free object, and a table."""

    def __init__(
        self, hand: Hand, pieces: Sequence[trimesh.Trimesh], support_height: float, *, table: bool
    ) -> None:
        self._model = mujoco.MjModel.from_xml_string(_mjcf(hand, pieces, table=table))
        self._data = mujoco.MjData(self._model)
        self._object = self._model.body(OBJECT).id
        self._start = np.array([0.0, 0.0, -support_height, 1.0, 0.0, 0.0, 0.0])
        joints = moving_joints(hand)
        self._leaders = [
            next(k for k, joint in enumerate(joints) if joint.name == name)
            for name in hand.joint_names
        ]

    def reset(self, postures: ServoPostures) -> None:
        """Set the hand to the pregrasp and the object to its place, at rest."""
        mujoco.mj_resetData(self._model, self._data)
        self._data.qpos[:] = np.concatenate([postures.pregrasp, self._start])
        self._command(postures.pregrasp)
        mujoco.mj_forward(self._model, self._data)

    def penetration(self) -> float:
        """Return the deepest penetration of the hand with the object or itself [m]."""
        bodies = self._model.geom_bodyid[self._data.contact.geom]
        distances = self._data.contact.dist[(bodies > 0).all(axis=1)]
        return float(-distances.min(initial=0.0))

    def push(self, direction: FloatArray) -> None:
        """Apply the test's force along a unit direction (3,) at the object's centre of mass."""
        self._data.xfrc_applied[self._object, :3] = _ACCELERATION * MASS * direction

    def close(self, postures: ServoPostures) -> None:
        """Move from the pregrasp to the planned posture, and on to the squeeze."""
        self.move(postures.pregrasp, postures.grasp)
        self.move(postures.grasp, postures.squeeze)

    def move(self, start: FloatArray, end: FloatArray) -> None:
        """Command postures on a straight line, the orientation on a geodesic."""
        turns = Rotation.from_quat([start[3:7], end[3:7]], scalar_first=True)
        turn = Slerp([0.0, 1.0], turns)
        for part in np.arange(1, _STEPS + 1) / _STEPS:
            posture = start + part * (end - start)
            posture[3:7] = turn(part).as_quat(scalar_first=True)
            self._command(posture)
            mujoco.mj_step(self._model, self._data, _STEPS)

    def holds_against(self, postures: ServoPostures, direction: FloatArray) -> bool:
        """Grasp anew, and return whether the object stays under a force from one direction."""
        self.reset(postures)
        self.close(postures)
        self.push(direction)
        checks, steps = _WAIT
        for _ in range(checks):
            mujoco.mj_step(self._model, self._data, steps)
            if not self.is_in_place(np.zeros(3)):
                return False
        return True

    def is_in_place(self, moved: FloatArray) -> bool:
        """Return whether the object is where it was, but for a displacement (3,) [m]."""
        pose = self._data.qpos[-7:]
        distance = np.linalg.norm(pose[:3] - self._start[:3] - moved)
        angle = Rotation.from_quat(pose[3:], scalar_first=True).magnitude()
        return bool(distance < _LARGEST_MOTION and angle < _LARGEST_TURN)

    def _command(self, posture: FloatArray) -> None:
        self._data.mocap_pos[0], self._data.mocap_quat[0] = posture[:3], posture[3:7]
        self._data.ctrl[:] = posture[7:][self._leaders]


def _mjcf(hand: Hand, pieces: Sequence[trimesh.Trimesh], *, table: bool) -> str:
    root = Element("mujoco", {"model": "dexgraspbench"})
    SubElement(root, "compiler", {"angle": "radian", "autolimits": "true"})
    option = SubElement(root, "option", {"timestep": numbers([_TIME_STEP]), "impratio": "10"})
    option.attrib |= {"integrator": "implicitfast", "cone": "elliptic", "noslip_iterations": "2"}
    SubElement(option, "flag", {"gravity": "disable"})
    assets, world = SubElement(root, "asset"), SubElement(root, "worldbody")
    if table:
        SubElement(world, "geom", {"type": "plane", "size": "0 0 1", **_FRICTION})
    written = servo_hand(hand)
    for geom in written.parts.root.iter("geom"):
        geom.attrib |= _HAND_CONTACT | _FRICTION
    base = SubElement(world, "body", {"name": _BASE})
    SubElement(base, "freejoint")
    base.append(written.parts.root)
    assets.extend(written.parts.meshes)
    SubElement(world, "body", {"name": _CARRIER, "mocap": "true"})
    constraints = SubElement(root, "equality")
    weld = {"body1": _CARRIER, "body2": _BASE, "solimp": "0.9 0.95 0.001 0.5 2"}
    SubElement(constraints, "weld", weld | {"relpose": "0 0 0 1 0 0 0"})
    constraints.extend(written.parts.couplings)
    root.extend([written.exclusions, written.actuators])
    body = SubElement(world, "body", {"name": OBJECT})
    SubElement(body, "freejoint")
    density = numbers([MASS / sum(piece.volume for piece in pieces)])
    for number, piece in enumerate(pieces):
        name = f"piece_{number}"
        assets.append(mesh_asset(name, piece.vertices))
        shape = {"name": name, "type": "mesh", "mesh": name, "density": density}
        SubElement(body, "geom", shape | _FRICTION)
    return ElementTree.tostring(root, encoding="unicode")
