"""Hands and objects in the user's plant, ready to touch and to be seen."""

from __future__ import annotations

from pathlib import Path

import trimesh
from pydrake.geometry import Mesh
from pydrake.math import RigidTransform
from pydrake.multibody.plant import MultibodyPlant
from pydrake.multibody.tree import Frame, ModelInstanceIndex, RigidBody

from lis_grasp.exceptions import InvalidOptionError
from lis_grasp.robots.hand import Hand
from lis_grasp.shapes import Shape, default_mass, find
from lis_grasp.shapes.object_mass import USUAL_FRICTION, require_load
from lis_grasp.shapes.solids import merge_flat_faces
from lis_grasp.simulation.drake import hand_plant, object_plant
from lis_grasp.simulation.drake.hand_plant import PROBING_SKIN, HandInPlant
from lis_grasp.simulation.drake.link_plant import add_visuals
from lis_grasp.simulation.drake.object_plant import in_memory
from lis_grasp.simulation.drake.plant_parts import (
    frame_of,
    instance_of,
    numbers_of,
    pose_of,
    require_plant,
    written_as,
    wrong_type,
)
from lis_grasp.typing import FloatArray

_WOOD = (0.8, 0.62, 0.4, 1.0)


@written_as("add_hand(plant, 'wsg50', name='left')")
def add_hand(
    plant: MultibodyPlant,
    hand: Hand | str | Path,
    *,
    name: str = "hand",
    instance: ModelInstanceIndex | str | None = None,
    parent: Frame | RigidBody | str | None = None,
    X_PG: RigidTransform | None = None,
    gains: tuple[FloatArray, FloatArray] | None = None,
    friction: float = USUAL_FRICTION,
    modulus: float = PROBING_SKIN,
) -> HandInPlant:
    """Add a hand to a plant, or find one that a parser has added, and return it.

    Links get compliant skin and visuals, do not collide with each other, and bear no weight. Joints
    get motors with implicit PD control: connect
    ``plant.get_desired_state_input_port(hand.instance)``. G is the frame of the base link's body;
    it floats unless there is a `parent`.

    Parameters
    ----------
    plant
        The plant, with a SceneGraph, not finalized yet.
    hand
        The hand, or its name or YAML file.
    name
        Name of the new model instance.
    instance
        The model instance, or its name, of a hand that ``Parser`` or directives added to the plant:
        links and joints are found by name. In a finalized plant it keeps its weight.
    parent, X_PG
        What G is welded to, and the pose of G in it.
    gains
        Stiffness and damping of the joints, each (J,) [N m/rad, N m s/rad; or N/m, N s/m]; None for
        the gains of probing.
    friction
        Coulomb's coefficient of every link.
    modulus
        Hydroelastic modulus of the skin [Pa].

    Raises
    ------
    InvalidOptionError
        If an option is not of its kind or range, or the instance lacks a link, a joint or a motor
        of the hand.
    InvalidHandError
        If there is no such hand.

    Examples
    --------
    >>> plant, _ = AddMultibodyPlantSceneGraph(DiagramBuilder(), 0.002)
    >>> hand = add_hand(plant, "wsg50", name="left", parent=plant.world_frame())
    >>> plant.GetModelInstanceName(hand.instance), hand.base.name()
    ('left', 'body')
    """
    plant = require_plant(plant)
    if not isinstance(hand, Hand | str | Path):
        raise wrong_type("hand", hand, "a Hand, its name or the path of its YAML file")
    found = hand if isinstance(hand, Hand) else Hand.load(hand)
    if instance is not None:
        return hand_plant.find_hand(plant, found, instance_of(plant, instance, "instance"))
    _require_open(plant, name)
    if parent is None and X_PG is not None:
        raise wrong_type("parent", parent, "the Frame or RigidBody of the pose X_PG")
    frame = None if parent is None else frame_of(plant, parent, "parent")
    X_PG = pose_of(X_PG, "X_PG")
    friction = float(numbers_of(friction, "friction", (), least=0.0))
    modulus = float(numbers_of(modulus, "modulus", (), least=1.0))
    if gains is not None:
        kp, kd = numbers_of(gains, "gains", (2, len(found.joint_names)), least=0.0)
        gains = kp, kd
    if plant.time_step() == 0.0 and any(joint.follows for joint in found.joints):
        raise InvalidOptionError(
            f"{found.name} needs a plant with a time step: Drake couples joints in discrete plants"
            " only",
            option="plant",
        )
    added = hand_plant.add_hand_model(
        plant, found, name=name, gains=gains, friction=friction, modulus=modulus
    )
    add_visuals(plant, found, added.links)
    if frame is not None:
        plant.WeldFrames(frame, added.base.body_frame(), X_PG)
    return added


@written_as("add_object(plant, 'part.stl', name='part')")
def add_object(
    plant: MultibodyPlant,
    obj: Shape | trimesh.Trimesh | str | Path,
    *,
    mass: float | None = None,
    friction: float = USUAL_FRICTION,
    name: str = "object",
    units: str = "m",
) -> RigidBody:
    """Add an object with its exact shape, ready for contact, and return its body.

    The mesh is rigid and hydroelastic, so bores and corners can be touched. Coplanar triangles are
    merged. The body floats; weld it, or set its pose by ``plant.SetDefaultFloatingBaseBodyPose``.

    Parameters
    ----------
    plant
        The plant, with a SceneGraph, not finalized yet.
    obj
        The name of a built-in shape, a mesh file, a `Shape`, or a watertight mesh [m].
    mass
        Mass [kg], at uniform density; None for the usual one of its size.
    friction
        Coulomb's coefficient.
    name
        Name of the model instance and of its body.
    units
        Length unit of a file.

    Raises
    ------
    InvalidFileError, InvalidMeshError
        If the object cannot be used.
    InvalidOptionError
        If mass or friction is out of range.

    Examples
    --------
    >>> plant, _ = AddMultibodyPlantSceneGraph(DiagramBuilder(), 0.002)
    >>> round(add_object(plant, "box", mass=0.3).default_mass(), 6)
    0.3
    """
    plant = require_plant(plant)
    if not isinstance(obj, Shape | trimesh.Trimesh | str | Path):
        raise wrong_type("obj", obj, "the name of a shape, a mesh file, a Shape or a mesh")
    if isinstance(obj, trimesh.Trimesh):
        obj = Shape.from_mesh(obj)
    shape = obj if isinstance(obj, Shape) else find(str(obj), units=units)
    mass = default_mass(shape.mesh) if mass is None else mass
    require_load(mass=mass, friction=friction)
    flat = merge_flat_faces(shape.mesh)
    _require_open(plant, name)
    body = object_plant.add_object_body(plant, flat, mass=mass, friction=friction, name=name).body
    look = Mesh(in_memory(shape.mesh, name))
    plant.RegisterVisualGeometry(body, RigidTransform(), look, f"{name}_visual", _WOOD)
    return body


def _require_open(plant: MultibodyPlant, name: str) -> None:
    """Raise `InvalidOptionError` unless a model instance of a name can be added to a plant."""
    if not isinstance(name, str):
        raise wrong_type("name", name, "the name of a new model instance")
    if not plant.geometry_source_is_registered():
        raise InvalidOptionError(
            "the plant needs a SceneGraph: make both by AddMultibodyPlantSceneGraph", option="plant"
        )
    if plant.is_finalized():
        raise InvalidOptionError(
            f"'{name}' must be added before plant.Finalize(), which was called", option="plant"
        )
    if plant.HasModelInstanceNamed(name):
        raise InvalidOptionError(
            f"the plant has a model instance '{name}': give another `name`", option="name"
        )
