"""Reader of the bodies beside the object: model directives, scenarios, models and meshes."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from pydrake.multibody.parsing import Parser, ProcessModelDirectives
from pydrake.multibody.plant import AddMultibodyPlantSceneGraph, MultibodyPlant
from pydrake.multibody.tree import ModelInstanceIndex, world_model_instance
from pydrake.systems.framework import Context, DiagramBuilder

from lis_grasp.exceptions import InvalidFileError, InvalidOptionError, nearest_or_all, note
from lis_grasp.geometry import make_pose
from lis_grasp.io.limits import reading
from lis_grasp.io.yaml_files import YAML_SUFFIXES
from lis_grasp.shapes.loading import load_obstacles
from lis_grasp.simulation.drake._world_directives import (
    drake_network,
    drake_reads,
    load_directives,
    local_packages,
)
from lis_grasp.simulation.drake.world_bodies import PlantBodies
from lis_grasp.typing import FloatArray
from lis_grasp.world import Body, Surroundings
from lis_grasp.world.files import file_of, scenario_of

_MODELS = (*YAML_SUFFIXES, ".sdf", ".urdf", ".xml")
_UPRIGHT = 1e-6  # largest difference from 1 of the height of a unit vector that points up


def load_surroundings(path: str | Path, at: str | None = None) -> Surroundings:
    """Return the bodies of a file in the frame E, on whose plane z = 0 the object stands.

    The file has model directives, scenarios of a HardwareStation (``scenarios.yaml#Name`` is one of
    several), a model (SDF, URDF, MJCF), or a mesh [m], which is one fixed body and may be open. A
    ``package.xml`` above the file names a package. Left out with a warning are robots of a
    scenario, models whose files are not on this disk, and what is placed on them. Shapes that are
    wholly at or below the table are left out.

    `at` is the place of E in the world of the file: the name of a body or frame, or three numbers
    [m]; None for its origin.

    Raises `InvalidFileError` and `InvalidMeshError` if the file cannot be used, and
    `InvalidOptionError` if it has more than 50 bodies or 200,000 triangles, or no upright frame
    `at`.

    Examples
    --------
    >>> load_surroundings("bin.dmd.yaml", at="0.1 0 0").bodies[0].name
    'front'
    """
    file, place = file_of(path), None if at is None else _numbers(at)
    if file.suffix.lower() not in _MODELS:
        bodies = Surroundings((Body.of_mesh(file.stem, load_obstacles(file)),))
        if at is not None and place is None:
            raise InvalidOptionError.out_of_range("at", at, "three numbers [m] in a mesh's frame")
        return bodies if place is None else bodies.in_frame(make_pose(np.eye(3), place))
    read = _Parsed(file, scenario_of(path))
    X_WE = np.eye(4) if place is None else make_pose(np.eye(3), place)
    if at is not None and place is None:
        X_WE = read.frame(at)
    surroundings = read.bodies.surroundings((), X_WE, 0.0)
    if not len(surroundings) and not read.bodies.count():
        raise InvalidFileError(
            f"{file} must have a body with collision geometry; it has none: add a <collision>, or"
            " leave `world` out",
            path=file,
        )
    if not len(surroundings):
        note(f"nothing in {file.name} rises above the table: the object is alone on it")
    return surroundings


class _Parsed:
    """The plant of a file's models, at their default positions."""

    def __init__(self, file: Path, scenario: str | None) -> None:
        builder = DiagramBuilder()
        plant, scene_graph = AddMultibodyPlantSceneGraph(builder, 0.001)
        packages = local_packages(file)
        with drake_network("package_map"):  # without it there is no Parser; it loads nothing yet
            parser = Parser(plant)
        for name in parser.package_map().GetPackageNames():
            parser.package_map().Remove(name)
        parser.package_map().AddMap(packages)
        if file.suffix.lower() in YAML_SUFFIXES:
            directives = load_directives(file, scenario, packages)
            with drake_reads(file):
                ProcessModelDirectives(directives, plant, parser)
        else:
            with reading(file, "a model"), drake_reads(file):
                parser.AddModels(str(file))
        plant.Finalize()
        self._diagram = builder.Build()
        self._root = self._diagram.CreateDefaultContext()
        self._plant: MultibodyPlant = plant
        self._context: Context = plant.GetMyContextFromRoot(self._root)
        self.bodies = PlantBodies(plant, scene_graph, self._context)

    def frame(self, name: str) -> FloatArray:
        """Return the pose (4, 4) of an upright frame; that of a model of one body by its name."""
        plant = self._plant
        model, _, own = name.rpartition("::")
        try:
            if not model and plant.HasModelInstanceNamed(name):
                bodies = plant.GetBodyIndices(plant.GetModelInstanceByName(name))
                frame = plant.get_body(bodies[0]).body_frame()
            elif not model:
                frame = plant.GetFrameByName(name)
            else:
                frame = plant.GetFrameByName(own, plant.GetModelInstanceByName(model))
        except RuntimeError:
            raise InvalidOptionError(
                f"`at` must be three numbers or a frame of the world; it is '{name}'"
                f"{nearest_or_all(name, self._frames())}",
                option="at",
                value=name,
            ) from None
        X_WF = np.asarray(frame.CalcPoseInWorld(self._context).GetAsMatrix4())
        if X_WF[2, 2] < 1.0 - _UPRIGHT:
            raise InvalidOptionError(
                f"the frame `at` must be upright, as the table is; axis z of {name} is not: add an"
                " upright frame there, or give three numbers",
                option="at",
                value=name,
            )
        return X_WF

    def _frames(self) -> list[str]:
        """Return the names of bodies and frames, but those that Drake makes itself."""
        plant, names = self._plant, []
        for k in map(ModelInstanceIndex, range(plant.num_model_instances())):
            scope = f"{plant.GetModelInstanceName(k)}::" if k != world_model_instance() else ""
            frames = [plant.get_frame(f).name() for f in plant.GetFrameIndices(k)]
            names += [f"{scope}{f}" for f in frames if f != "__model__" and "_welds_to_" not in f]
        return names


def _numbers(at: str) -> FloatArray | None:
    """Return a position (3,) [m]; None for the name of a frame."""
    try:
        numbers = np.array([float(word) for word in at.replace(",", " ").split()])
    except ValueError:
        return None
    if numbers.shape != (3,) or not np.isfinite(numbers).all():
        raise InvalidOptionError.out_of_range("at", at, "three numbers [m], or a frame's name")
    return numbers
