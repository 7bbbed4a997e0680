"""Object descriptions for simulators: URDF, SDF and MJCF with mass, inertia and convex parts."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from types import MappingProxyType
from xml.etree import ElementTree

import numpy as np
import trimesh

from lis_grasp.exceptions import InvalidOptionError
from lis_grasp.io.atomic_writing import write_text
from lis_grasp.shapes.object_mass import require_load, uniform_inertia
from lis_grasp.typing import FloatArray

_DRAKE = "http://drake.mit.edu"

VISUAL = "visual.obj"
"""File of the mesh that is drawn, in the folder of a model."""

MARK = "<!-- lis-grasp export -->"
"""Comment in each description, which shows that this package wrote the folder."""

# MuJoCo's coefficients of torsional [m] and rolling friction [m], its defaults.
_TORSION, _ROLLING = 0.005, 0.0001


@dataclass(frozen=True, slots=True, eq=False)
class ObjectModel:
    """A rigid object of uniform density, in its frame O.

    Raises `InvalidOptionError` if mass or friction are out of range, or there are no parts.
    """

    name: str  #: letters, digits, ``_``, ``-`` and ``.``
    mesh: trimesh.Trimesh  #: drawn, and filled by the mass: watertight [m]
    parts: tuple[trimesh.Trimesh, ...]  #: for collisions: convex meshes [m]
    mass: float  #: [kg]
    friction: float  #: Coulomb's coefficient, static and dynamic

    def __post_init__(self) -> None:
        require_load(mass=self.mass, friction=self.friction)
        if not self.parts:
            message = "an object model needs at least one convex part; there is none"
            raise InvalidOptionError(message, option="parts")

    def __repr__(self) -> str:
        return f"ObjectModel({self.name!r}, {self.mass:g} kg, {len(self.parts)} convex parts)"

    @property
    def center(self) -> FloatArray:
        """Centre of mass, shape (3,) [m]."""
        return np.asarray(self.mesh.center_mass)

    @property
    def inertia(self) -> FloatArray:
        """Inertia about the centre of mass along O's axes, shape (3, 3) [kg m^2]."""
        return uniform_inertia(self.mesh, self.mass)

    def save(self, folder: Path, format_name: str) -> Path:
        """Write the description and its meshes into a folder, and return the description's path.

        Raises `InvalidOptionError` if there is no such format in `FORMATS`, `InvalidFileError` if a
        file cannot be written.
        """
        if format_name not in FORMATS:
            raise InvalidOptionError.not_one_of("format", format_name, FORMATS)
        ending, describe = FORMATS[format_name]
        for file, mesh in ((VISUAL, self.mesh), *zip(_files(self), self.parts, strict=True)):
            plain = trimesh.Trimesh(mesh.vertices, mesh.faces, process=False)
            write_text(folder / file, str(plain.export(file_type="obj", header="")))
        root = describe(self)
        ElementTree.indent(root)
        path = folder / f"{self.name}{ending}"
        text = ElementTree.tostring(root, encoding="unicode")
        write_text(path, f'<?xml version="1.0"?>\n{MARK}\n{text}\n')
        return path


def _files(model: ObjectModel) -> list[str]:
    return [f"part_{k:02d}.obj" for k in range(len(model.parts))]


def _numbers(*values: float) -> str:
    return " ".join(f"{value:.9g}" for value in values)


def _moments(model: ObjectModel) -> dict[str, str]:
    axes = "xyz"
    return {
        f"i{axes[i]}{axes[j]}": _numbers(model.inertia[i, j]) for i in range(3) for j in range(i, 3)
    }


def _child(
    parent: ElementTree.Element, tag: str, text: str = "", **attributes: str
) -> ElementTree.Element:
    child = ElementTree.SubElement(parent, tag, attributes)
    child.text = text or None
    return child


def _urdf(model: ObjectModel) -> ElementTree.Element:
    robot = ElementTree.Element("robot", {"name": model.name, "xmlns:drake": _DRAKE})
    link = _child(robot, "link", name=model.name)
    inertial = _child(link, "inertial")
    _child(inertial, "origin", xyz=_numbers(*model.center), rpy="0 0 0")
    _child(inertial, "mass", value=_numbers(model.mass))
    _child(inertial, "inertia", **_moments(model))
    _child(_child(_child(link, "visual"), "geometry"), "mesh", filename=VISUAL)
    for file in _files(model):
        collision = _child(link, "collision", name=Path(file).stem)
        mesh = _child(_child(collision, "geometry"), "mesh", filename=file)
        _child(mesh, "drake:declare_convex")
        properties = _child(collision, "drake:proximity_properties")
        _child(properties, "drake:rigid_hydroelastic")
        for name in ("drake:mu_static", "drake:mu_dynamic"):
            _child(properties, name, value=_numbers(model.friction))
    return robot


def _sdf(model: ObjectModel) -> ElementTree.Element:
    sdf = ElementTree.Element("sdf", {"version": "1.9", "xmlns:drake": _DRAKE})
    link = _child(_child(sdf, "model", name=model.name), "link", name=model.name)
    inertial = _child(link, "inertial")
    _child(inertial, "pose", _numbers(*model.center, 0.0, 0.0, 0.0))
    _child(inertial, "mass", _numbers(model.mass))
    inertia = _child(inertial, "inertia")
    for name, moment in _moments(model).items():
        _child(inertia, name, moment)
    visual = _child(link, "visual", name="visual")
    _child(_child(_child(visual, "geometry"), "mesh"), "uri", VISUAL)
    for file in _files(model):
        collision = _child(link, "collision", name=Path(file).stem)
        mesh = _child(_child(collision, "geometry"), "mesh")
        _child(mesh, "uri", file)
        _child(mesh, "drake:declare_convex")
        ode = _child(_child(_child(collision, "surface"), "friction"), "ode")
        for name in ("mu", "mu2"):
            _child(ode, name, _numbers(model.friction))
        # Drake reads the friction under ode, and warns if it is given twice.
        _child(_child(collision, "drake:proximity_properties"), "drake:rigid_hydroelastic")
    return sdf


def _mjcf(model: ObjectModel) -> ElementTree.Element:
    mujoco = ElementTree.Element("mujoco", {"model": model.name})
    assets = _child(mujoco, "asset")
    body = _child(_child(mujoco, "worldbody"), "body", name=model.name)
    _child(body, "freejoint")
    moments = _moments(model)
    _child(
        body,
        "inertial",
        pos=_numbers(*model.center),
        mass=_numbers(model.mass),
        fullinertia=" ".join(moments[k] for k in ("ixx", "iyy", "izz", "ixy", "ixz", "iyz")),
    )
    # Names of meshes belong to the whole scene, which may include several objects.
    drawing = f"{model.name}_visual"
    _child(assets, "mesh", name=drawing, file=VISUAL)
    drawn = {"type": "mesh", "contype": "0", "conaffinity": "0", "group": "2"}
    _child(body, "geom", mesh=drawing, **drawn)
    friction = _numbers(model.friction, _TORSION, _ROLLING)
    for file in _files(model):
        name = f"{model.name}_{Path(file).stem}"
        _child(assets, "mesh", name=name, file=file)
        _child(body, "geom", type="mesh", mesh=name, group="3", friction=friction)
    return mujoco


FORMATS: Mapping[str, tuple[str, Callable[[ObjectModel], ElementTree.Element]]] = MappingProxyType(
    {"urdf": (".urdf", _urdf), "sdf": (".sdf", _sdf), "mjcf": (".xml", _mjcf)}
)
"""Ending and writer of each format, by its name."""
