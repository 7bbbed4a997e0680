"""Worlds of files: directives, scenarios, models and meshes, what is left out, what is refused."""

import os
import re
import warnings
from pathlib import Path

import numpy as np
import pytest
import trimesh
from pydrake.geometry import Box, Cylinder, HalfSpace, Sphere
from pydrake.math import RigidTransform
from pydrake.multibody.plant import AddMultibodyPlantSceneGraph, CoulombFriction
from pydrake.multibody.tree import PrismaticJoint, SpatialInertia
from pydrake.systems.framework import DiagramBuilder
from scipy.spatial.transform import Rotation

from lis_grasp import shapes
from lis_grasp.drake import add_object
from lis_grasp.exceptions import (
    InvalidFileError,
    InvalidInputError,
    InvalidOptionError,
    LisGraspWarning,
)
from lis_grasp.simulation.drake.world_bodies import surroundings_of
from lis_grasp.simulation.drake.world_reader import load_surroundings
from lis_grasp.world import Body, Surroundings

BOX = """<sdf version="1.7"><model name="{name}"><link name="{name}_link">
<inertial><pose>0 0 0.01 0 0 0</pose><mass>0.3</mass><inertia>
<ixx>1e-4</ixx><ixy>0</ixy><ixz>0</ixz><iyy>2e-4</iyy><iyz>0</iyz><izz>3e-4</izz></inertia></inertial>
<collision name="c"><geometry><box><size>{size}</size></box></geometry></collision>
{more}</link>{joints}</model></sdf>"""

DIRECTIVES = """
directives:
- add_model: {name: wall, file: "package://bench/wall.sdf"}
- add_weld:
    parent: world
    child: wall::wall_link
    X_PC: {translation: [0.2, 0.0, 0.1], rotation: !Rpy {deg: [0.0, 0.0, 90.0]}}
- add_model: {name: floor, file: "package://bench/floor.sdf"}
- add_weld: {parent: world, child: "floor::floor_link", X_PC: {translation: [0.0, 0.0, -0.05]}}
- add_frame:
    name: inside
    X_PF: {base_frame: "wall::wall_link", translation: [0.0, 0.3, -0.1]}
- add_model:
    name: crate
    file: package://bench/crate.sdf
    default_free_body_pose: {crate_link: {translation: [0.0, 0.1, 0.05]}}
"""

ROBOTS = """
- add_model: {name: robot, file: "package://bench/slide.sdf"}
- add_weld: {parent: world, child: "robot::slide_link"}
- add_model: {name: gripper, file: "package://bench/wall.sdf"}
- add_weld: {parent: "robot::slide_link", child: "gripper::wall_link"}
- add_model: {name: camera, file: "package://bench/crate.sdf"}
- add_weld: {parent: "gripper::wall_link", child: "camera::crate_link"}
- add_model: {name: stand, file: "package://drake_models/stand.sdf"}
- add_weld: {parent: world, child: "stand::base"}
- add_model: {name: door, file: "package://bench/slide.sdf"}
- add_weld: {parent: world, child: "door::slide_link", X_PC: {translation: [0.0, 0.4, 0.1]}}
"""

SLIDE = """<link name="drawer"><inertial><mass>1</mass></inertial><collision name="c">
<pose>0 0 0.2 0 0 0</pose><geometry><sphere><radius>0.05</radius></sphere></geometry></collision>
</link><joint name="j" type="prismatic"><parent>slide_link</parent><child>drawer</child>
<axis><xyz>0 0 1</xyz></axis></joint>"""


@pytest.fixture
def bench(tmp_path: Path) -> Path:
    """A folder that is the package ``bench``, with models and directives."""
    (tmp_path / "package.xml").write_text("<package><name>bench</name></package>")
    for name, size, more, joints in (
        ("wall", "0.02 0.4 0.2", "", ""),
        ("floor", "2 2 0.1", "", ""),
        ("crate", "0.06 0.06 0.1", "", ""),
        ("slide", "0.1 0.1 0.1", "", SLIDE),
    ):
        text = BOX.format(name=name, size=size, more=more, joints=joints)
        (tmp_path / f"{name}.sdf").write_text(text)
    (tmp_path / "deeper").mkdir()
    (tmp_path / "deeper" / "world.dmd.yaml").write_text(DIRECTIVES)
    again = 'directives:\n- add_directives: {file: "package://bench/deeper/world.dmd.yaml"}\n'
    drivers = "model_drivers:\n  robot: !IiwaDriver {hand_model_name: gripper}\n  gripper: !W {}\n"
    (tmp_path / "one.scenario.yaml").write_text(again + ROBOTS + drivers)
    several = "".join(
        f"{name}:\n" + "".join(f"  {line}\n" for line in text.splitlines())
        for name, text in (("Alone", again), ("Both", again + ROBOTS + drivers))
    )
    (tmp_path / "several.yaml").write_text(several)
    return tmp_path


def _warnings(path: Path | str, at: str | None = None) -> tuple[Surroundings, str]:
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        surroundings = load_surroundings(path, at)
    assert all(issubclass(w.category, LisGraspWarning) for w in caught)
    return surroundings, " ".join(str(w.message) for w in caught)


def _names(surroundings: Surroundings) -> list[str]:
    return [body.name for body in surroundings]


def test_a_package_without_its_package_xml_is_named_as_the_cause(bench: Path) -> None:
    (bench / "package.xml").unlink()
    wall = '- add_model: {name: wall, file: "package://bench/wall.sdf"}\n'
    alone, beside = bench / "deeper" / "alone.dmd.yaml", bench / "beside.dmd.yaml"
    alone.write_text(f"directives:\n{wall}")
    advice = rf"write <package><name>bench</name></package> to {re.escape(str(bench))}"
    with pytest.raises(InvalidFileError, match=rf"on this disk; it has wall \(.*{advice}"):
        load_surroundings(alone)
    crate = f"- add_model: {{name: crate, file: 'file://{bench}/crate.sdf'}}\n"
    beside.write_text(f"directives:\n{wall}{crate}")
    surroundings, said = _warnings(beside)
    assert _names(surroundings) == ["crate"]
    assert re.search(advice, said)


def test_directives_give_fixed_and_free_bodies_at_their_places(bench: Path) -> None:
    surroundings, said = _warnings(bench / "deeper" / "world.dmd.yaml")
    assert _names(surroundings) == ["wall", "crate"]  # the floor is the table
    wall, crate = surroundings
    np.testing.assert_allclose(wall.mesh.bounds, [[0.0, -0.01, 0.0], [0.4, 0.01, 0.2]], atol=1e-9)
    assert wall.is_fixed
    assert crate.inertial is not None
    assert crate.inertial.mass == 0.3
    np.testing.assert_allclose(crate.inertial.center_L, [0.0, 0.0, 0.01])
    np.testing.assert_allclose(np.diag(crate.inertial.inertia_L), [1e-4, 2e-4, 3e-4])
    assert not said


def test_a_scenario_is_read_without_robots_and_what_lacks_and_names_them(bench: Path) -> None:
    surroundings, said = _warnings(bench / "one.scenario.yaml")
    assert _names(surroundings) == ["wall", "crate", "door::slide_link", "door::drawer"]
    assert all(body.is_fixed for body in surroundings if body.name != "crate")
    for name in ("robot", "gripper", "camera", "stand", "package://drake_models/stand.sdf"):
        assert name in said
    assert "door::drawer" in said  # frozen
    assert "wall" not in said


def test_a_scenario_of_several_is_chosen_by_its_name(bench: Path) -> None:
    file = bench / "several.yaml"
    assert _names(_warnings(f"{file}#Alone")[0]) == ["wall", "crate"]
    assert "door::drawer" in _names(_warnings(f"{file}#Both")[0])
    for path in (file, f"{file}#Neither", f"{bench / 'deeper' / 'world.dmd.yaml'}#Some"):
        with pytest.raises(InvalidFileError) as refused:
            load_surroundings(path)
        assert refused.value.field == "directives"


@pytest.mark.parametrize("at", ["inside", "0.2 0 0", "0.2, 0, 0"])
def test_the_table_is_where_at_says(bench: Path, at: str) -> None:
    """In closed form: the wall's axis y is -x of the world, 0.3 m along it is x = -0.1 m."""
    file = bench / "deeper" / "world.dmd.yaml"
    in_world, placed = load_surroundings(file), load_surroundings(file, at)
    X_WE = np.eye(4)
    if at == "inside":
        X_WE[:3, :3] = Rotation.from_euler("z", 90, degrees=True).as_matrix()
        X_WE[:3, 3] = [-0.1, 0.0, 0.0]
    else:
        X_WE[0, 3] = 0.2
    for body, moved in zip(in_world, placed, strict=True):
        np.testing.assert_allclose(X_WE @ moved.X_EB, body.X_EB, atol=1e-12)


def test_a_higher_table_takes_what_is_below_it(bench: Path) -> None:
    assert _names(load_surroundings(bench / "deeper" / "world.dmd.yaml", "0 0 0.15")) == ["wall"]


@pytest.mark.parametrize("at", ["nowhere", "wall::nothing", "0 0", "0 0 nan", "lying"])
def test_a_place_that_is_none_is_refused(bench: Path, at: str) -> None:
    file = bench / "deeper" / "world.dmd.yaml"
    lying = (
        "- add_frame: {name: lying, X_PF: {base_frame: world, rotation: !Rpy {deg: [90, 0, 0]}}}"
    )
    file.write_text(DIRECTIVES + lying)
    with pytest.raises(InvalidOptionError) as refused:
        load_surroundings(file, at)
    assert (refused.value.option, refused.value.value) == ("at", at)


def test_a_mesh_is_one_fixed_body_at_a_place(tmp_path: Path) -> None:
    trimesh.creation.box((0.1, 0.1, 0.1)).export(tmp_path / "block.stl")
    (body,) = load_surroundings(tmp_path / "block.stl", "0.3 0 0")
    assert (body.name, body.is_fixed) == ("block", True)
    np.testing.assert_allclose(body.mesh.bounds.mean(axis=0), [-0.3, 0.0, 0.0], atol=1e-6)
    with pytest.raises(InvalidOptionError):
        load_surroundings(tmp_path / "block.stl", "block")


def _scene(bench: Path, models: str) -> Path:
    path = bench / "scene.dmd.yaml"
    path.write_text("directives:\n" + models)
    return path


def test_a_world_of_a_table_alone_is_empty_and_says_so(bench: Path) -> None:
    floor = '- add_model: {name: floor, file: "package://bench/floor.sdf"}\n'
    weld = (
        '- add_weld: {parent: world, child: "floor::floor_link", X_PC: {translation: [0,0,-1]}}\n'
    )
    surroundings, said = _warnings(_scene(bench, floor + weld))
    assert not len(surroundings)
    assert "scene.dmd.yaml" in said


@pytest.mark.parametrize(
    ("text", "error"),
    [
        ("- add_model: {name: a, file: 'package://bench/missing.sdf'}\n", InvalidFileError),
        ("- add_model: {name: a, file: 'package://drake_models/a.sdf'}\n", InvalidFileError),
        ("- add_model: {name: a, file: 'package://bench/ghost.sdf'}\n", InvalidFileError),
        ("- add_weld: {parent: world, child: 'a::b'}\n", InvalidFileError),
        ("- add_nothing: {}\n", InvalidFileError),
        ("- add_directives: {file: 'package://elsewhere/a.dmd.yaml'}\n", InvalidFileError),
        ("- [", InvalidFileError),
        pytest.param(
            "".join(
                f"- add_model: {{name: a{k}, file: 'package://bench/wall.sdf'}}\n"
                for k in range(51)
            ),
            InvalidOptionError,
            marks=pytest.mark.slow,
        ),
    ],
)
@pytest.mark.filterwarnings("ignore::lis_grasp.exceptions.LisGraspWarning")
def test_a_world_that_cannot_be_used_is_refused(
    bench: Path, text: str, error: type[InvalidInputError]
) -> None:
    """A missing or broken file, no collision geometry, an unknown package, too many bodies."""
    (bench / "ghost.sdf").write_text(
        "<sdf version='1.7'><model name='g'><link name='l'/></model></sdf>"
    )
    with pytest.raises(error):
        load_surroundings(_scene(bench, text))


@pytest.mark.parametrize("absolute", [False, True])
def test_a_path_that_is_no_url_gets_the_url_that_is_read(bench: Path, absolute: bool) -> None:
    given = str(bench / "wall.sdf") if absolute else "wall.sdf"
    weld = "- add_weld: {parent: world, child: 'a::wall_link'}\n"
    with pytest.raises(InvalidFileError) as caught:
        load_surroundings(_scene(bench, f"- add_model: {{name: a, file: {given}}}\n{weld}"))
    (url,) = re.findall(r"write (file://\S+),", str(caught.value))
    (body,) = load_surroundings(_scene(bench, f"- add_model: {{name: a, file: '{url}'}}\n{weld}"))
    package = _scene(bench, f"- add_model: {{name: a, file: 'package://bench/wall.sdf'}}\n{weld}")
    (same,) = load_surroundings(package)
    np.testing.assert_array_equal(body.mesh.vertices, same.mesh.vertices)


def test_nothing_is_downloaded_or_left_in_the_environment(
    bench: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("DRAKE_ALLOW_NETWORK", "lcm")
    monkeypatch.setenv("XDG_CACHE_HOME", str(bench / "cache"))
    monkeypatch.setenv("TEST_TMPDIR", str(bench / "cache"))
    with pytest.warns(LisGraspWarning):
        load_surroundings(bench / "one.scenario.yaml")
    assert os.environ["DRAKE_ALLOW_NETWORK"] == "lcm"
    assert not list(bench.rglob("*.zip"))


def test_bodies_of_an_own_plant_are_at_their_present_poses() -> None:
    builder = DiagramBuilder()
    plant, scene_graph = AddMultibodyPlantSceneGraph(builder, 0.002)
    friction = CoulombFriction(0.4, 0.4)

    def add(name: str, shape: object, model: str = "", X: RigidTransform | None = None) -> object:
        instance = plant.AddModelInstance(model or name)
        inertia = SpatialInertia.SolidBoxWithMass(0.5, 0.1, 0.1, 0.1)
        body = plant.AddRigidBody(name, instance, inertia)
        place = X or RigidTransform()
        plant.RegisterCollisionGeometry(body, place, shape, name, friction)
        return body

    robot, shelf = add("robot", Sphere(0.1)), add("shelf", Box(0.4, 0.2, 0.02))
    drawer, cup = add("drawer", Box(0.1, 0.1, 0.1)), add("cup", Cylinder(0.03, 0.1))
    handle = add("handle", Sphere(0.01), X=RigidTransform([0.0, 0.0, 0.0]))
    plant.RegisterCollisionGeometry(
        plant.world_body(), RigidTransform(), HalfSpace(), "ground", friction
    )
    plant.WeldFrames(plant.world_frame(), robot.body_frame())
    plant.WeldFrames(plant.world_frame(), shelf.body_frame(), RigidTransform([0, 0, 0.3]))
    plant.WeldFrames(cup.body_frame(), handle.body_frame(), RigidTransform([0.04, 0.0, 0.0]))
    slide = plant.AddJoint(PrismaticJoint("j", plant.world_frame(), drawer.body_frame(), [1, 0, 0]))
    plant.Finalize()
    diagram = builder.Build()
    context = plant.GetMyContextFromRoot(diagram.CreateDefaultContext())
    slide.set_translation(context, 0.7)
    X_WC = RigidTransform([0.1, 0.2, 0.35])
    plant.SetFreeBodyPose(context, cup, X_WC)

    with pytest.warns(LisGraspWarning) as caught:
        found = surroundings_of(plant, scene_graph, context, without=["robot"], table=None)
    assert "drawer" in str(caught[0].message)
    bodies = {body.name: body for body in found}
    assert sorted(bodies) == ["cup", "drawer", "shelf"]
    assert [name for name in bodies if not bodies[name].is_fixed] == ["cup"]
    np.testing.assert_allclose(bodies["drawer"].X_EB[:3, 3], [0.7, 0.0, 0.0])
    np.testing.assert_allclose(bodies["cup"].X_EB, X_WC.GetAsMatrix4())
    assert bodies["cup"].friction == pytest.approx(0.4)
    assert len(bodies["cup"].geometries) == 2  # with its handle, whose mass it carries
    assert bodies["cup"].inertial.mass == pytest.approx(1.0)
    np.testing.assert_allclose(bodies["cup"].inertial.center_L, [0.02, 0.0, 0.0], atol=1e-15)
    lower = surroundings_of(
        plant, scene_graph, context, without=[robot.model_instance()], table=0.32
    )
    assert _names(lower) == ["cup"]


def test_a_mesh_in_memory_is_read() -> None:
    """An object of `add_object` is a neighbour, or is left out, in a plant of one's own."""
    builder = DiagramBuilder()
    plant, scene_graph = AddMultibodyPlantSceneGraph(builder, 0.001)
    add_object(plant, "box", name="carton")
    add_object(plant, "cylinder")
    plant.Finalize()
    context = plant.CreateDefaultContext()
    (carton,) = surroundings_of(plant, scene_graph, context, without=["object"], table=None)
    assert carton.name == "carton"
    assert carton.inertial.mass == pytest.approx(0.2)
    expected = shapes.find("box").mesh
    np.testing.assert_allclose(carton.mesh.bounds, expected.bounds, atol=1e-9)
    assert carton.mesh.volume == pytest.approx(expected.volume)


def test_too_many_triangles_are_refused() -> None:
    many = trimesh.creation.icosphere(subdivisions=5)  # 20,480 triangles
    bodies = tuple(Body.of_mesh(f"ball {k}", many) for k in range(10))
    with pytest.raises(InvalidOptionError) as refused:
        Surroundings(bodies)
    assert refused.value.value == 204_800
