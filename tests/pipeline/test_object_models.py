"""Object descriptions: what Drake reads is what was written, and convex parts keep holes."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import trimesh

from lis_grasp import shapes
from lis_grasp.cli.main import main
from lis_grasp.exceptions import InvalidOptionError
from lis_grasp.exports.object_models import FORMATS, ObjectModel
from lis_grasp.shapes.mesh_distance import InsideTest
from lis_grasp.shapes.solids import convex_parts


@pytest.fixture(scope="module")
def box() -> ObjectModel:
    """A box off its frame's origin and aslant, so that every entry of the inertia is tested."""
    mesh = trimesh.creation.box((0.04, 0.06, 0.1))
    mesh.apply_transform(trimesh.transformations.euler_matrix(0.3, 0.4, 0.5))
    mesh.apply_translation((0.01, 0.02, 0.03))
    return ObjectModel("part", mesh, convex_parts(mesh), mass=0.3, friction=0.7)


@pytest.mark.parametrize("name", FORMATS)
def test_drake_reads_mass_inertia_and_parts(
    name: str, box: ObjectModel, tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    from pydrake.geometry import SceneGraph
    from pydrake.multibody.parsing import Parser
    from pydrake.multibody.plant import MultibodyPlant

    plant, scene = MultibodyPlant(1e-3), SceneGraph()
    plant.RegisterAsSourceForSceneGraph(scene)
    Parser(plant).AddModels(str(box.save(tmp_path, name)))
    plant.Finalize()
    body = plant.GetBodyByName("part")
    inertia = body.default_spatial_inertia()
    assert inertia.get_mass() == pytest.approx(0.3, rel=1e-8)
    # Written with nine digits.
    assert inertia.get_com() == pytest.approx(np.array([0.01, 0.02, 0.03]), rel=1e-7)
    about_center = inertia.Shift(inertia.get_com()).CalcRotationalInertia().CopyToFullMatrix3()
    principal = 0.3 / 12.0 * np.array([0.06**2 + 0.1**2, 0.04**2 + 0.1**2, 0.04**2 + 0.06**2])
    assert np.linalg.eigvalsh(about_center) == pytest.approx(np.sort(principal), rel=1e-6)
    assert about_center == pytest.approx(box.inertia, rel=1e-6)
    collisions = plant.GetCollisionGeometriesForBody(body)
    # Drake's MJCF parser also registers geometry that MuJoCo draws only.
    assert len(collisions) == len(box.parts) + (name == "mjcf" and len(collisions) > 1)
    assert len(plant.GetVisualGeometriesForBody(body)) >= 1
    properties = [scene.model_inspector().GetProximityProperties(part) for part in collisions]
    if name == "mjcf":
        return
    assert all(each.HasGroup("hydroelastic") for each in properties)
    frictions = [each.GetProperty("material", "coulomb_friction") for each in properties]
    assert [each.static_friction() for each in frictions] == len(frictions) * [0.7]
    assert not caplog.records


def test_a_convex_object_is_one_part_and_a_hollow_one_keeps_its_hole() -> None:
    (only,) = convex_parts(shapes.build("pentagon").mesh)
    assert only.volume == pytest.approx(shapes.build("pentagon").mesh.volume, rel=1e-6)
    ring = shapes.build("torus").mesh
    assert len(convex_parts(ring, most=1)) == 1
    with pytest.raises(InvalidOptionError) as error:
        convex_parts(ring, most=0)
    assert (error.value.option, error.value.value) == ("most", 0)


@pytest.mark.slow
def test_the_hole_of_a_ring_is_in_no_part() -> None:
    ring = shapes.build("torus").mesh
    parts = convex_parts(ring, most=16)
    assert 8 <= len(parts) <= 16
    assert all(part.is_convex and part.is_watertight for part in parts)
    assert not any(InsideTest(part).inside(ring.bounds.mean(axis=0)[None])[0] for part in parts)
    points = np.random.default_rng(0).uniform(*ring.bounds, size=(2000, 3))
    inside = points[InsideTest(ring).inside(points)]
    covered = np.any([InsideTest(part).inside(inside) for part in parts], axis=0)
    # Voxels of 1 mm round the surface of a tube of 20 mm radius are 10 % of its volume.
    assert covered.mean() > 0.94
    again = convex_parts(ring, most=16)
    assert all(np.array_equal(a.vertices, b.vertices) for a, b in zip(parts, again, strict=True))


def test_the_command_replaces_its_own_models_only(tmp_path: Path) -> None:
    mesh = tmp_path / "ball.stl"
    trimesh.creation.icosphere(radius=0.03).export(mesh)
    export = ["export", str(mesh), "--units", "m", "--format", "urdf", "--output", str(tmp_path)]
    (tmp_path / "ball.urdf").write_text("<robot/>")
    assert main(export) == 2
    assert (tmp_path / "ball.urdf").read_text() == "<robot/>"
    (tmp_path / "ball.urdf").unlink()
    (tmp_path / "part_00.obj").write_text("o mine")
    assert main(export) == 2
    (tmp_path / "part_00.obj").unlink()
    assert main(export) == 0
    assert main(export) == 0  # its own
    drawn = (tmp_path / "visual.obj").read_bytes()
    export[1] = str(tmp_path / "visual.obj")
    assert main(export) == 2  # its input
    assert (tmp_path / "visual.obj").read_bytes() == drawn


def test_the_command_writes_the_formats_that_are_named(tmp_path: Path) -> None:
    file = tmp_path / "cube.stl"
    trimesh.creation.box((40.0, 40.0, 40.0)).export(file)
    assert main(["export", str(file), "--units", "mm", "--format", "sdf", "mjcf"]) == 0
    written = {path.name for path in (tmp_path / "model").iterdir()}
    assert written == {"cube.sdf", "cube.xml", "visual.obj", "part_00.obj"}
    assert trimesh.load(tmp_path / "model" / "part_00.obj").extents == pytest.approx([0.04] * 3)
    assert main(["export", str(file), "--units", "mm", "--mass", "0"]) == 2


def test_mjcf_of_two_objects_has_no_name_twice(box: ObjectModel) -> None:
    models = [replace(box, name=name) for name in ("left", "right")]
    roots = [FORMATS["mjcf"][1](model) for model in models]
    names = [each.get("name") for root in roots for each in root.iter() if each.get("name")]
    assert len(names) == len(set(names))
