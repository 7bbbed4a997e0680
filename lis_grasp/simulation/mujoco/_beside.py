"""Bodies beside the object in MuJoCo: their MJCF of convex pieces, poses, and forces on them."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from xml.etree.ElementTree import Element, SubElement

import numpy as np

from lis_grasp.exceptions import needed_package
from lis_grasp.geometry import make_pose
from lis_grasp.motion import OBJECT
from lis_grasp.robots.mjcf import inertial, mesh_asset, pose, shape_attributes
from lis_grasp.robots.robot_model import LinkGeometry
from lis_grasp.simulation.mujoco.convex_pieces import convex_pieces
from lis_grasp.typing import FloatArray
from lis_grasp.world import Body, Surroundings

with needed_package("mujoco", "mujoco", option="the simulator mujoco"):
    import mujoco

BESIDE = "beside/"
"""Put before the names of the bodies beside the object."""


def add_beside(world: Element, assets: Element, body: Body, contact: Mapping[str, str]) -> None:
    """Add a body to an MJCF's world and assets, with attributes of its geometries."""
    element = SubElement(world, "body", {"name": BESIDE + body.name, **pose(body.X_EB)})
    if body.inertial is not None:
        SubElement(element, "freejoint", {"name": BESIDE + body.name})
        mass = body.inertial
        element.append(inertial(mass.mass, mass.center_L, mass.inertia_L))
    for number, piece in enumerate(_convex(body)):
        name = f"{BESIDE}{body.name}_{number}"
        geom = SubElement(element, "geom", {"name": name, **contact})
        geom.attrib |= shape_attributes(piece, name)
        if piece.kind == "mesh":
            assets.append(mesh_asset(name, piece.mesh.vertices))


def _convex(body: Body) -> Iterator[LinkGeometry]:
    """Yield the shapes of a body, meshes as convex pieces."""
    for geometry in body.geometries:
        if geometry.kind != "mesh":
            yield geometry
            continue
        for part in geometry.mesh.split(only_watertight=True, repair=False):
            for piece in convex_pieces(part):
                yield LinkGeometry(geometry.link, geometry.X_LG, "mesh", (), piece)


class BesideInModel:
    """The bodies beside the object in a model of MuJoCo."""

    def __init__(self, model: mujoco.MjModel, surroundings: Surroundings, hand: set[int]) -> None:
        self._model = model
        self._names = {model.body(BESIDE + body.name).id: body.name for body in surroundings}
        self._free = {body.name: model.body(BESIDE + body.name).id for body in surroundings.free}
        self._object = model.body(OBJECT).id
        self._pushers = hand | {self._object}
        self._kept = dict[int, FloatArray]()  # poses (7,) of free bodies that nothing has touched

    def rest(self, data: mujoco.MjData) -> None:
        """Keep the free bodies where they are until something touches them."""
        self._kept = {body: data.qpos[self._q(body)].copy() for body in self._free.values()}

    def keep(self, data: mujoco.MjData) -> None:
        """Put those back that nothing has touched, after a step."""
        moving = self._pushers | (set(self._free.values()) - self._kept.keys())
        for first, second in self._model.geom_bodyid[data.contact.geom]:
            for own, other in ((first, second), (second, first)):
                if other in moving:
                    self._kept.pop(int(own), None)
        for body, kept in self._kept.items():
            data.qpos[self._q(body)] = kept
            velocity = self._model.body_dofadr[body]
            data.qvel[velocity : velocity + 6] = 0.0

    def _q(self, body: int) -> slice:
        start = self._model.jnt_qposadr[self._model.body_jntadr[body]]
        return slice(start, start + 7)

    def poses(self, data: mujoco.MjData) -> dict[str, FloatArray]:
        """Return the poses X_WB (4, 4) of the free bodies."""
        return {
            name: make_pose(data.xmat[body].reshape(3, 3), data.xpos[body])
            for name, body in self._free.items()
        }

    def forces(self, data: mujoco.MjData) -> dict[str, float]:
        """Return the forces [N] of hand and object on each body that they touch.

        They are sums over contacts of the sizes of their forces.
        """
        sums: dict[str, float] = {}
        for number, name, _ in self._contacts(data):
            wrench = np.zeros(6)
            mujoco.mj_contactForce(self._model, data, number, wrench)
            sums[name] = sums.get(name, 0.0) + float(np.linalg.norm(wrench[:3]))
        return sums

    def touch_object(self, data: mujoco.MjData) -> bool:
        """Return whether a free body touches the object."""
        return any(
            body == self._object and name in self._free for _, name, body in self._contacts(data)
        )

    def _contacts(self, data: mujoco.MjData) -> Iterator[tuple[int, str, int]]:
        """Yield number, touched body, and number of the body that touches it."""
        for number in range(data.ncon):
            first, second = (
                int(self._model.geom_bodyid[geom]) for geom in data.contact.geom[number]
            )
            for own, other in ((first, second), (second, first)):
                if own in self._names and other in self._pushers:
                    yield number, self._names[own], other
