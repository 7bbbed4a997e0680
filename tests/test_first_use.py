"""First use in Python: calls with plain values are equal to those of the pipeline."""

import inspect
import re
import subprocess
import sys
from dataclasses import fields, is_dataclass
from importlib import import_module
from importlib.util import find_spec
from pathlib import Path
from pkgutil import resolve_name

import numpy as np
import pytest
import trimesh

import lis_grasp
import lis_grasp.drake
from lis_grasp import (
    Contacts,
    ForceClosureSampler,
    Grasp,
    GraspSearch,
    Hand,
    RunConfig,
    pipeline,
)
from lis_grasp._moved import MOVED
from lis_grasp.cli.main import build_parser
from lis_grasp.cli.options import configure_touch
from lis_grasp.exceptions import (
    InvalidContactsError,
    InvalidFileError,
    InvalidMeshError,
    InvalidOptionError,
    LisGraspWarning,
    NoGraspError,
)
from lis_grasp.pipeline import Scenario, direct
from lis_grasp.stages.agent import Agent
from lis_grasp.task.task import Task

AXES = np.vstack([np.eye(3), -np.eye(3)])
CONTACTS = Contacts(0.03 * AXES, AXES, fingers=tuple("abcdef"), free_points=[[0.1, 0.0, 0.0]])
# Names that documentation, examples and notebooks of version 1.4 import.
DOCUMENTED = Path(__file__).with_name("documented_names_1_4.txt")
KINEMATIC = {"prober": "kinematic", "touches": 3, "estimator": "gpis"}


@pytest.fixture(scope="module")
def gripper() -> Hand:
    return Hand.load("wsg50")


@pytest.fixture(scope="module")
def box() -> trimesh.Trimesh:
    return trimesh.creation.box((0.04, 0.05, 0.06))


# ---------------------------------------------------------------- contacts


def test_contacts_are_sliced_joined_and_iterated() -> None:
    assert CONTACTS[2:4].fingers == ("c", "d")
    assert CONTACTS[-1].fingers == CONTACTS[np.int64(5)].fingers == ("f",)
    assert CONTACTS[CONTACTS.points[:, 0] > 0.0].fingers == ("a",)
    assert [one.fingers[0] for one in CONTACTS] == list("abcdef")
    assert len(CONTACTS[3].free_points) == 1
    assert (CONTACTS[:2] + CONTACTS[4:]).fingers == ("a", "b", "e", "f")
    with pytest.raises(IndexError, match="6"):
        CONTACTS[6]
    with pytest.raises(TypeError):
        CONTACTS + 1  # type: ignore[operator]


def test_contacts_are_read_in_their_unit(tmp_path: Path) -> None:
    path = tmp_path / "mug.csv"
    Contacts(1e3 * CONTACTS.points, AXES).save(path)
    for read in (Contacts.load, lis_grasp.load_contacts):
        np.testing.assert_allclose(read(path, units="mm").points, CONTACTS.points)
        with pytest.raises(InvalidContactsError, match=r"60 m .*\bmm\b"):
            read(path)
        with pytest.raises(InvalidOptionError, match="m, cm, mm, inch"):
            read(path, units="km")


def test_two_contacts_of_one_touch_are_read(tmp_path: Path) -> None:
    contacts = Contacts([[0.0, 0.0, 0.0], [1e-5, 0.0, 0.0]], AXES[:2])
    contacts.save(tmp_path / "edge.ply")
    assert len(Contacts.load(tmp_path / "edge.ply")) == 2


# ---------------------------------------------------------------- estimates


def test_an_estimate_is_that_of_the_pipeline() -> None:
    surface = lis_grasp.estimate(CONTACTS, "gpis", support_height=-0.03)
    of_2_0 = lis_grasp.estimate(CONTACTS, "gpis", table=-0.03)
    known = pipeline.Perception(estimator="gpis", table=-0.03)
    points = 0.01 * np.arange(12.0).reshape(4, 3)
    for other in (of_2_0, pipeline.estimate(known, CONTACTS)[0]):
        np.testing.assert_array_equal(surface.evaluate(points), other.evaluate(points))
    with pytest.raises(InvalidOptionError, match="'blend'"):
        lis_grasp.estimate(CONTACTS, "blendd")
    with pytest.raises(InvalidFileError, match=r"contacts\.ply"):
        lis_grasp.estimate("contacts.ply")


# ---------------------------------------------------------------- grasps


@pytest.fixture(scope="module")
def search(gripper: Hand, box: trimesh.Trimesh) -> GraspSearch:
    return lis_grasp.plan(box, gripper, grasps=2)


def test_a_search_is_a_sequence_with_a_best_grasp(search: GraspSearch) -> None:
    assert [grasp.epsilon for grasp in search] == [g.quality["epsilon"] for g in search.grasps]
    assert len(search) == 2
    assert search[:1] == (search.best,)
    assert isinstance(search[-1], Grasp)
    assert search.best.pose is search.best.X_OH
    assert 0.0 < (search.best.success_probability or 0.0) <= 1.0
    with pytest.raises(NoGraspError, match="7.*collision 5.*reach 2"):
        GraspSearch((), {"reach": 2, "collision": 5}, 7).best  # noqa: B018


@pytest.mark.slow
def test_a_seed_stands_for_a_generator(gripper: Hand, box: trimesh.Trimesh) -> None:
    sampler = ForceClosureSampler(gripper, candidates=50)
    first, second = sampler.sample(box, count=1), sampler.sample(box, rng=0, count=1)
    third = sampler.sample(box, rng=np.random.default_rng(0), count=1)
    assert first.rejections == second.rejections == third.rejections
    np.testing.assert_array_equal(first.best.pose, third.best.pose)


@pytest.mark.slow
def test_a_plan_is_that_of_the_pipeline(gripper: Hand, box: trimesh.Trimesh) -> None:
    config = RunConfig(object="object", friction=0.5, grasps=1, seed=3)
    known = Agent.of(config, -0.03, hand=gripper)
    wanted = pipeline.plan(known, box).best
    planned = lis_grasp.plan(box, "wsg50", rng=3, friction=0.5, grasps=1).best
    np.testing.assert_array_equal(planned.pose, wanted.pose)


# ---------------------------------------------------------------- stages without records


def test_an_exploration_is_that_of_the_pipeline(gripper: Hand, box: trimesh.Trimesh) -> None:
    shape = lis_grasp.Shape.from_mesh(box)
    scenario = Scenario.from_config(RunConfig(object="object", seed=2, **KINEMATIC), shape, gripper)
    wanted = pipeline.touch(scenario).contacts.points
    for given, options in ((box, {"rng": 2}), (shape, {"seed": 2})):
        explored = lis_grasp.explore(given, gripper, known=True, **KINEMATIC, **options)
        np.testing.assert_array_equal(explored.contacts.points, wanted)


def test_an_unknown_option_is_refused_with_the_nearest(tmp_path: Path) -> None:
    for call in (lis_grasp.explore, lis_grasp.plan, lis_grasp.run):
        with pytest.raises(TypeError, match="'frictoin'.*'friction'"):
            call("box", frictoin=0.5)
    with pytest.raises(TypeError, match="'n': use touches"):  # not the nearest of "grasps"
        lis_grasp.explore("box", n=3)
    with pytest.raises(InvalidOptionError, match="'GPIS': did you mean 'gpis'"):
        lis_grasp.estimate(CONTACTS, "GPIS")
    with pytest.raises(TypeError, match="'whatever': it has .*friction, grasps"):
        lis_grasp.plan("box", whatever=1)
    with pytest.raises(TypeError, match="^grasp .*Grasp"):
        lis_grasp.lift("box", "wsg50", GraspSearch(()))  # type: ignore[arg-type]
    with pytest.raises(TypeError, match="'postion_noise'.*'position_noise'"):
        lis_grasp.estimate(CONTACTS, postion_noise=0.001)


def test_points_and_normals_apart_are_told_how_they_go_together() -> None:
    points, normals = CONTACTS.points, CONTACTS.normals
    with pytest.raises(InvalidOptionError) as error:
        lis_grasp.estimate(points, normals)  # type: ignore[arg-type]
    assert error.value.option == "estimator"
    assert "estimate((points, normals))" in str(error.value)
    lis_grasp.estimate((points, normals), "gpis")


@pytest.mark.parametrize(("count", "worth"), [(1, "no size"), (9, "little more than position")])
def test_an_estimate_from_few_contacts_says_what_it_is_worth(count: int, worth: str) -> None:
    points = np.repeat(0.03 * AXES, 2, axis=0)[:count] + 0.01 * np.eye(12, 3)[:count]
    with pytest.warns(LisGraspWarning, match=worth):
        lis_grasp.estimate(Contacts(points, np.repeat(AXES, 2, axis=0)[:count]), "gpis")


def test_a_mesh_in_millimetres_is_refused(gripper: Hand, box: trimesh.Trimesh) -> None:
    wrong = box.copy().apply_scale(1e3)
    for call in (
        lambda: lis_grasp.surface_error(box, wrong),
        lambda: lis_grasp.surface_error(wrong, box),
        lambda: lis_grasp.plan(wrong, gripper),
        lambda: lis_grasp.explore(wrong, gripper),
    ):
        with pytest.raises(
            InvalidMeshError, match=r"60 m large.*apply_scale\(0.001\) if it is in mm$"
        ):
            call()
    for nothing in (CONTACTS, trimesh.Trimesh()):
        with pytest.raises(InvalidMeshError, match=r"extract_mesh\(surface\)"):
            lis_grasp.surface_error(nothing, box)  # type: ignore[arg-type]
        with pytest.raises(InvalidMeshError, match=r"mesh with faces"):
            lis_grasp.Shape.from_mesh(nothing)  # type: ignore[arg-type]
    with pytest.raises(InvalidMeshError, match="mesh with faces"):
        lis_grasp.plan(trimesh.Trimesh(), gripper)


def test_contacts_of_arrays_in_millimetres_are_noted() -> None:
    with pytest.warns(LisGraspWarning, match="in metres, and these are 60 m apart"):
        lis_grasp.estimate(Contacts(30.0 * AXES, AXES), "gpis")


@pytest.fixture
def configs(monkeypatch: pytest.MonkeyPatch) -> list[RunConfig]:
    """Return the configurations of the runs of a test, which end before their first stage."""
    seen: list[RunConfig] = []
    monkeypatch.setattr(direct, "run_task", lambda config, *_, **__: seen.append(config))
    return seen


def test_a_run_takes_an_object_and_a_hand_as_other_stages_do(configs: list[RunConfig]) -> None:
    lis_grasp.run("sphere", "wsg50", touches=5)
    lis_grasp.run(Task.of("sphere", hand="wsg50"), touches=5)
    lis_grasp.run(Task.of("sphere"), Path("wsg50"), touches=5)
    wanted = Task.of("sphere", hand="wsg50", touches=5).facts()
    assert [config.facts() for config in configs] == 3 * [wanted]


def test_a_run_has_the_conditions_of_the_command(
    configs: list[RunConfig],
) -> None:
    lis_grasp.run("box", known=True)
    lis_grasp.run("box")
    for config, flags in zip(configs, (["--known"], []), strict=True):
        assert config == configure_touch(build_parser("run").parse_args(["run", "box", *flags]))


def test_a_run_refuses_what_it_cannot_record(gripper: Hand, box: trimesh.Trimesh) -> None:
    with pytest.raises(TypeError, match="object.*Trimesh"):
        lis_grasp.run(box)  # type: ignore[arg-type]
    with pytest.raises(TypeError, match="hand.*Hand"):
        lis_grasp.run("box", gripper)  # type: ignore[arg-type]
    with pytest.raises(TypeError, match="'output'"):
        lis_grasp.run("box", output="x")


def test_the_configuration_of_a_stage_names_its_hand_and_object(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(direct, "touch", lambda scenario: scenario)
    for hand in ("wsg50", Hand.load("wsg50")):
        scenario = lis_grasp.explore("sphere", hand)
        assert scenario.task.world.object == "sphere"
        assert scenario.task.robot.hand == "wsg50"
        assert scenario.agent.hand.name == "wsg50"


def test_an_option_that_a_stage_does_not_use_is_refused(box: trimesh.Trimesh) -> None:
    for stage, name in (("plan", "touches"), ("plan", "pose"), ("explore", "grasps")):
        with pytest.raises(TypeError, match=f"'{name}'"):
            getattr(lis_grasp, stage)(box, "wsg50", **{name: 1})
    for load in ({"friction": 0.5}, {"mass": 0.1, "friction": 0.5}):
        with pytest.raises(InvalidOptionError, match=".*".join(sorted(load))):
            lis_grasp.plan(box, "wsg50", load="unknown", **load)


def test_one_seed_is_given(box: trimesh.Trimesh) -> None:
    with pytest.raises(TypeError, match="rng.*seed"):
        lis_grasp.plan(box, "wsg50", rng=1, seed=2)
    with pytest.raises(TypeError, match="^rng .*None"):
        lis_grasp.explore(box, "wsg50", rng=None)  # type: ignore[arg-type]


def test_a_grasp_names_its_hand(
    gripper: Hand, box: trimesh.Trimesh, search: GraspSearch, monkeypatch: pytest.MonkeyPatch
) -> None:
    grasp = search.best
    monkeypatch.setattr(direct, "lift_object", lambda scenario, grasp: (scenario, grasp))
    for arguments in ((grasp,), (gripper, grasp), ("wsg50", grasp)):
        scenario, lifted = lis_grasp.lift(box, *arguments)
        assert (scenario.agent.hand.name, lifted) == ("wsg50", grasp)
    with pytest.raises(TypeError, match="'region'"):
        lis_grasp.lift(box, grasp, region=(0.2, 0.2, 0.2))
    for arguments in ((), ("wsg50",), (grasp, "wsg50")):
        with pytest.raises(TypeError, match=r"^grasp of lift\(object, hand, grasp\) .*Grasp"):
            lis_grasp.lift(box, *arguments)


def test_a_name_stands_for_an_object_or_is_answered() -> None:
    box = lis_grasp.shapes.find("box")
    for truth in ("box", box):
        assert lis_grasp.surface_error(box.mesh, truth, samples=100).rmsd < 1e-6
    with pytest.raises(InvalidFileError, match=r"shapes.find\('box'\)"):
        lis_grasp.shapes.load("box")


# ---------------------------------------------------------------- names


def test_every_public_name_is_found_after_importing_the_package_alone() -> None:
    program = "import lis_grasp\nfor name in lis_grasp.__all__: getattr(lis_grasp, name)"
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True)
    assert done.returncode == 0, done.stderr


@pytest.mark.parametrize(
    "name",
    ["", ".pipeline", ".surfaces", ".exploration", ".shapes", ".visualization", ".task"]
    + [".logs", ".drake"],
)
def test_the_signature_of_a_public_class_names_its_fields(name: str) -> None:
    package = import_module(f"lis_grasp{name}")
    public = (getattr(package, name) for name in package.__all__)
    records = [value for value in public if inspect.isclass(value) and is_dataclass(value)]
    for kind in (kind for kind in records if "names_of_2" not in kind.__module__):
        made = {field.name for field in fields(kind) if field.init}
        assert set(inspect.signature(kind).parameters) == made, kind


def test_an_old_name_of_a_module_gives_the_module_of_today(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(MOVED, "lis_grasp.shapes.old_shape", "lis_grasp.shapes.shape")
    monkeypatch.setitem(MOVED, "lis_grasp.pipeline.OldShape", "lis_grasp.shapes.shape.Shape")
    try:
        assert import_module("lis_grasp.shapes.old_shape").Shape is lis_grasp.Shape
    finally:
        sys.modules.pop("lis_grasp.shapes.old_shape", None)
        vars(lis_grasp.shapes).pop("old_shape", None)
    assert pipeline.OldShape is lis_grasp.Shape


def test_every_module_that_moved_resolves() -> None:
    for old, new in MOVED.items():
        assert _resolved(old) is resolve_name(new), old


def _resolved(dotted: str) -> object:
    """Return what a dotted name stands for, or the sentence of its error."""
    parts = dotted.split(".")
    for k in range(len(parts), 0, -1):
        try:
            value: object = import_module(".".join(parts[:k]))
        except ModuleNotFoundError as error:
            if error.name is None:
                return str(error)
            continue
        for part in parts[k:]:
            value = getattr(value, part)
        return value
    raise AssertionError(dotted)


def test_a_documented_name_of_1_4_works_or_says_where_it_is() -> None:
    for name in DOCUMENTED.read_text(encoding="utf-8").split():
        if "mujoco" in name and find_spec("mujoco") is None:
            continue
        value = _resolved(name)
        if isinstance(value, str) and " is now " in value:
            places = re.findall(r"lis_grasp\w*(?:\.\w+)+", value.split(" is now ")[1])
            assert places, value
            assert all(_resolved(place) is not None for place in places), value


@pytest.mark.parametrize(
    "statement",
    [
        "import lis_grasp.hands.hand",
        "from lis_grasp.hands.hand import Hand",
        "from lis_grasp import hands",
        "from lis_grasp.arms import arm_ik",
        "from lis_grasp.exploration import contacts_from_log",
        "from lis_grasp.pipeline import table_of",
        "lis_grasp.hands",
        "lis_grasp.exploration.open_log",
    ],
)
def test_a_moved_name_is_answered_by_a_sentence(statement: str) -> None:
    with pytest.raises((ImportError, AttributeError), match=r"lis_grasp\.[\w.]+ is now "):
        exec(statement, {"lis_grasp": lis_grasp})


def test_completion_shows_public_names_alone() -> None:
    for package in (lis_grasp, pipeline, lis_grasp.shapes):
        assert dir(package) == sorted(package.__all__)
