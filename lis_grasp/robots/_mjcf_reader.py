"""Reading of a hand's links and joints from an MJCF file (compiled by MuJoCo)."""

from __future__ import annotations

import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import trimesh
import yourdfpy
from scipy.spatial.transform import Rotation

from lis_grasp.exceptions import InvalidFileError, InvalidHandError, needed_package
from lis_grasp.geometry import inverse_pose, make_pose
from lis_grasp.robots._mjcf_couplings import Couplings, mjt_name, name_of
from lis_grasp.robots._urdf import naming
from lis_grasp.robots.inertias import LEAST_MASS, small_ball
from lis_grasp.robots.link_bodies import Capsule, GivenMesh
from lis_grasp.robots.model_uri import resolve_uri
from lis_grasp.typing import FloatArray

_WORLD = 0  # MuJoCo's number of the world body
_LEAST_TURN = 0.1  # [rad] of the joint of a hand that turns most; less is in another unit


def parse_mjcf(path: Path) -> yourdfpy.Robot:
    """Return the links and joints of an MJCF as a URDF would have them.

    MuJoCo compiles the file, with its defaults, classes, includes and units. The base is the one
    body on the world that carries joints, else the world. Joints have MuJoCo's positions. A joint
    whose anchor is not the origin of its body moves a link ``<joint>_frame``, on which the body is
    fixed; so does each but the last of several joints of a body. `Couplings` says what follows, and
    what is fixed; the attribute ``notes`` of the result lists such decisions.

    Raises `InvalidOptionError` if MuJoCo is not installed, and `InvalidFileError`,
    `InvalidHandError` if the file cannot be compiled; if its joints form closed chains, turn like
    balls, or are pulled by tendons over sites.
    """
    with needed_package("mujoco", "mujoco", option=f"{path.name}, an MJCF,"):
        import mujoco
    try:
        model = mujoco.MjModel.from_xml_path(str(path))
    except ValueError as error:
        reason = " ".join(str(error).split()).removeprefix("Error: ")
        if missing := re.search(r"opening file '([^']+)'", reason):
            resolve_uri(missing[1], path.parent, str(path))  # names a file in other letters
        named = f"{path}, or a file that it includes" if b"<include" in path.read_bytes() else path
        raise InvalidFileError(f"MuJoCo cannot read {named}: {reason}", path=path) from None
    with naming(path):
        return _Reader(model, path).robot()


class _Reader:
    """A compiled model, the bodies in it that are the hand, and what moves its joints."""

    def __init__(self, model: Any, path: Path) -> None:
        self._m, self._path = model, path
        self._root, self._bodies = self._hand()
        self._couplings = Couplings(model, self._bodies)
        turns = [
            float(np.ptp(model.jnt_range[j]))
            for j in self._couplings.efforts
            if model.jnt_limited[j] and mjt_name("Joint", model.jnt_type[j]) == "hinge"
        ]
        if 0.0 < max(turns, default=0.0) < _LEAST_TURN:
            least, widest = np.degrees([_LEAST_TURN, max(turns)])
            raise InvalidHandError(
                f"the widest range of a hinge must be {least:.0f} degrees or more; it is"
                f" {widest:.2g}: in an MJCF, ranges are in degrees unless it has"
                ' <compiler angle="radian"/>'
            )

    def robot(self) -> yourdfpy.Robot:
        links, joints = [], []
        for body in self._bodies:
            link = yourdfpy.Link(self._body(body), inertial=self._inertial(body))
            self._add_geometry(link, body)
            links.append(link)
            if body == self._root:
                continue
            made = list(self._chain(body))
            joints += made
            for joint in made[:-1]:
                matter = None
                if made[-1].type != "fixed" or joint is not made[-2]:
                    matter = yourdfpy.Inertial(np.eye(4), LEAST_MASS, small_ball(LEAST_MASS))
                links.append(yourdfpy.Link(joint.child, inertial=matter))
        robot = yourdfpy.Robot(self._path.stem, links, joints)
        robot.notes = tuple(self._couplings.notes)
        return robot

    def _hand(self) -> tuple[int, tuple[int, ...]]:
        """Return the base and all its bodies, parents first; loose objects are left out."""
        m = self._m
        top = {b: b for b in range(m.nbody) if m.body_parentid[b] == _WORLD}
        for b in range(1, m.nbody):
            top.setdefault(b, top[m.body_parentid[b]])
        moved = {top[m.jnt_bodyid[j]] for j in range(m.njnt) if not self._is_free(j)}
        loose = {b for b in top.values() if b not in moved and m.body_jntnum[b]}
        loose |= {b for b in top.values() if m.body_mocapid[b] >= 0}
        base = min(moved, default=_WORLD)
        held = all(self._is_free(j) for j in self._joints_of(base))
        root = base if len(moved) == 1 and held else _WORLD
        kept = [b for b in range(m.nbody) if (top[b] == root if root else top[b] not in loose)]
        return root, tuple(kept)

    def _is_free(self, joint: int) -> bool:
        return mjt_name("Joint", self._m.jnt_type[joint]) == "free"

    def _joints_of(self, body: int) -> range:
        first = int(self._m.body_jntadr[body])
        return range(first, first + int(self._m.body_jntnum[body])) if first >= 0 else range(0)

    def _body(self, number: int) -> str:
        return name_of(self._m, "body", number)

    def _inertial(self, body: int) -> yourdfpy.Inertial:
        m = self._m
        X = _pose(m.body_ipos[body], m.body_iquat[body])
        return yourdfpy.Inertial(X, float(m.body_mass[body]), np.diag(m.body_inertia[body]))

    def _add_geometry(self, link: yourdfpy.Link, body: int) -> None:
        m, first = self._m, int(self._m.body_geomadr[body])
        for g in range(first, first + int(m.body_geomnum[body])):
            geometry = self._geometry(g)
            if geometry is None:
                continue
            X = _pose(m.geom_pos[g], m.geom_quat[g])
            if m.geom_contype[g] or m.geom_conaffinity[g]:
                link.collisions.append(yourdfpy.Collision("", X, geometry))
            else:
                link.visuals.append(yourdfpy.Visual("", X, geometry))
        if not link.visuals:
            link.visuals = [yourdfpy.Visual("", c.origin, c.geometry) for c in link.collisions]

    def _geometry(self, g: int) -> yourdfpy.Geometry | None:
        m, size = self._m, self._m.geom_size[g].tolist()
        match mjt_name("Geom", m.geom_type[g]):
            case "box":
                return yourdfpy.Geometry(box=yourdfpy.Box(2.0 * m.geom_size[g]))
            case "sphere":
                return yourdfpy.Geometry(sphere=yourdfpy.Sphere(size[0]))
            case "cylinder" | "capsule" as kind:
                made = Capsule if kind == "capsule" else yourdfpy.Cylinder
                return yourdfpy.Geometry(cylinder=made(size[0], 2.0 * size[1]))
            case "ellipsoid":
                ball = trimesh.creation.icosphere().apply_scale(size)
                return yourdfpy.Geometry(mesh=GivenMesh(ball))
            case "mesh" | "sdf":
                mesh = m.mesh(int(m.geom_dataid[g]))
                vertices = m.mesh_vert[mesh.vertadr[0] :][: mesh.vertnum[0]].astype(np.float64)
                faces = m.mesh_face[mesh.faceadr[0] :][: mesh.facenum[0]]
                solid = trimesh.Trimesh(vertices, faces, process=False)
                return yourdfpy.Geometry(mesh=GivenMesh(solid))
        return None  # a plane or a height field is no part of a hand

    def _chain(self, body: int) -> Iterator[yourdfpy.Joint]:
        """Yield the joints from a body's parent to it."""
        m = self._m
        parent, X = self._body(m.body_parentid[body]), _pose(m.body_pos[body], m.body_quat[body])
        joints = self._joints_of(body)
        for joint in joints:
            name, kind = name_of(m, "joint", joint), mjt_name("Joint", m.jnt_type[joint])
            if kind not in ("hinge", "slide"):
                raise InvalidHandError(f"joint '{name}' must be a hinge or a slide; it is a {kind}")
            anchor = make_pose(np.eye(3), m.jnt_pos[joint])
            last = joint == joints[-1] and not m.jnt_pos[joint].any()
            child = self._body(body) if last else f"{name}_frame"
            at_zero = self._moved(joint, -float(m.qpos0[m.jnt_qposadr[joint]]))
            yield self._made(joint, parent, child, X @ anchor @ at_zero)
            parent, X = child, inverse_pose(anchor)
        if parent != self._body(body):
            yield yourdfpy.Joint(f"{self._body(body)}_mount", "fixed", parent, self._body(body), X)

    def _made(self, joint: int, parent: str, child: str, X: FloatArray) -> yourdfpy.Joint:
        m, couplings, name = self._m, self._couplings, name_of(self._m, "joint", joint)
        if joint in couplings.rests:
            X = X @ self._moved(joint, couplings.rests[joint])
            return yourdfpy.Joint(name, "fixed", parent, child, X)
        hinge = mjt_name("Joint", m.jnt_type[joint]) == "hinge"
        kind = "revolute" if hinge else "prismatic"
        limit = yourdfpy.Limit(effort=couplings.efforts.get(joint))
        if m.jnt_limited[joint]:
            limit.lower, limit.upper = m.jnt_range[joint].tolist()
        elif hinge:
            kind = "continuous"
        mimic = None
        if joint in couplings.followers:
            leader, multiplier, offset = couplings.followers[joint]
            mimic = yourdfpy.Mimic(name_of(m, "joint", leader), multiplier, offset)
        axis = m.jnt_axis[joint].copy()
        return yourdfpy.Joint(name, kind, parent, child, X, axis, limit=limit, mimic=mimic)

    def _moved(self, joint: int, position: float) -> FloatArray:
        """Return the motion (4, 4) of a joint by a position [rad or m]."""
        along = position * self._m.jnt_axis[joint]
        if mjt_name("Joint", self._m.jnt_type[joint]) == "slide":
            return make_pose(np.eye(3), along)
        return make_pose(Rotation.from_rotvec(along).as_matrix(), np.zeros(3))


def _pose(position: FloatArray, quaternion: FloatArray) -> FloatArray:
    return make_pose(Rotation.from_quat(quaternion, scalar_first=True).as_matrix(), position)
