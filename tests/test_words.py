"""Words of other libraries: they mean what the package's own names mean, and hide none of them."""

import copy
import inspect
import pickle
from pathlib import Path
from pkgutil import resolve_name

import numpy as np
import pytest

import lis_grasp
from lis_grasp import Contacts, Grasp, GraspSearch, Hand, Run
from lis_grasp._words import FUNCTIONS, MEMBERS, OPTIONS, in_our_words
from lis_grasp.cli.main import build_parser, main
from lis_grasp.exceptions import InvalidContactsError
from lis_grasp.robots.arm import Arm
from lis_grasp.surfaces import BlendedImplicitSurface
from lis_grasp.task.task import task_options

AXES = np.vstack([np.eye(3), -np.eye(3)])
CONTACTS = Contacts(0.03 * AXES, AXES)
POINTS = 0.01 * np.arange(12.0).reshape(4, 3)
WORDED = (Contacts, Grasp, GraspSearch, Hand, Arm, Run, BlendedImplicitSurface)


@pytest.mark.parametrize("word", FUNCTIONS)
def test_a_function_has_other_words(word: str) -> None:
    assert getattr(lis_grasp, word) is not None
    ours = resolve_name(f"lis_grasp.{FUNCTIONS[word]}")
    assert getattr(lis_grasp, word) == ours
    assert word not in dir(lis_grasp)


@pytest.mark.parametrize("kind", WORDED)
def test_members_by_other_words_hide_none_and_are_not_completed(kind: type) -> None:
    own = {name for name in dir(kind) if not name.startswith("_")}
    answered = {word for name, words in MEMBERS.items() if name in own for word in words}
    assert answered - own
    assert not answered & {"points", "normals", "load", "save", "evaluate", "joint_positions"}


def test_every_member_with_other_words_is_of_a_class() -> None:
    assert not {*MEMBERS} - {name for kind in WORDED for name in dir(kind)}


def test_a_member_and_a_class_method_are_found_by_other_words(tmp_path: Path) -> None:
    path = tmp_path / "c.csv"
    CONTACTS.to_csv(path)
    np.testing.assert_array_equal(Contacts.from_csv(path).xyz, CONTACTS.points)
    X = np.eye(4)
    X[0, 3] = 0.1
    moved = CONTACTS.transform(X)
    np.testing.assert_array_equal(moved.points, CONTACTS.in_frame(X).points)
    surface = lis_grasp.estimate(CONTACTS, "gpis")
    np.testing.assert_array_equal(surface.std(POINTS), surface.uncertainty(POINTS))
    assert Hand.from_yaml("wsg50").joint_names == Hand.load("wsg50").joint_names


def test_a_function_of_an_object_may_be_called_as_its_method() -> None:
    surface = CONTACTS.estimate("gpis")
    np.testing.assert_array_equal(
        surface.evaluate(POINTS), lis_grasp.estimate(CONTACTS, "gpis").evaluate(POINTS)
    )
    mesh = surface.to_mesh(voxel_size=0.01)
    np.testing.assert_array_equal(
        mesh.vertices, lis_grasp.extract_mesh(surface, resolution=0.01).vertices
    )
    assert CONTACTS.to_dict()["points"] is CONTACTS.points


def test_an_unknown_member_is_answered_by_the_nearest_or_all() -> None:
    with pytest.raises(AttributeError, match="'points'"):
        CONTACTS.pointz  # noqa: B018
    with pytest.raises(AttributeError, match="bounds.*evaluate.*gradient"):
        lis_grasp.estimate(CONTACTS, "gpis").sdf  # noqa: B018
    with pytest.raises(AttributeError, match="Contacts.*nothing_alike"):
        Contacts.nothing_alike  # noqa: B018
    with pytest.raises(AttributeError, match="extract_mesh"):
        lis_grasp.extract_meshes  # noqa: B018


def test_an_error_of_a_property_is_its_own() -> None:
    with pytest.raises(InvalidContactsError, match="at least one"):
        Contacts.empty().bounds  # noqa: B018


def test_a_record_is_still_copied_pickled_and_its_signature_known() -> None:
    again = pickle.loads(pickle.dumps(CONTACTS))  # noqa: S301
    assert again == CONTACTS == copy.deepcopy(CONTACTS)
    assert [*inspect.signature(Contacts).parameters][:2] == ["points", "normals"]
    assert [*inspect.signature(lis_grasp.plan).parameters][:2] == ["mesh", "hand"]
    assert not hasattr(CONTACTS, "__array_interface__")


@pytest.mark.parametrize(
    "call",
    [
        lambda: lis_grasp.estimate(CONTACTS, method="gpis", noise=1e-3, table=-0.03),
        lambda: lis_grasp.estimate(
            CONTACTS, model="gpis", position_noise=1e-3, support_height=-0.03
        ),
    ],
)
def test_options_by_other_words_give_the_same_estimate(call: object) -> None:
    ours = lis_grasp.estimate(CONTACTS, "gpis", position_noise=1e-3, support_height=-0.03)
    np.testing.assert_array_equal(call().evaluate(POINTS), ours.evaluate(POINTS))  # type: ignore[operator]


def test_an_option_is_given_once_and_a_functions_own_word_stays() -> None:
    for twice in ({"mu": 0.5, "friction": 0.5}, {"mu": 0.5, "friction_coefficient": 0.5}):
        with pytest.raises(TypeError, match="twice"):
            in_our_words(twice, ["friction"])
    assert in_our_words({"table": 1, "spacing": 2}, ["table", "support_height"]) == {
        "table": 1,
        "spacing": 2,
    }
    with pytest.raises(TypeError, match="voxels"):
        lis_grasp.extract_mesh(CONTACTS, voxels=3)
    words = {word for words in OPTIONS.values() for word in words}
    assert not words & {*task_options()}
    assert lis_grasp.explore("box", "wsg50", n=1, prober="kinematic", estimator="gpis").made == 1


def test_what_a_file_has_may_be_an_array_or_a_table(tmp_path: Path) -> None:
    path = tmp_path / "points.csv"
    CONTACTS.save(path)
    table = np.asarray(CONTACTS)
    names = np.rec.fromarrays(1e3 * CONTACTS.points.T, names="x_mm,y_mm,z_mm")
    for source in (path, str(path), table, table.tolist(), CONTACTS.points[:, :3], names):
        read = lis_grasp.load_contacts(source)
        np.testing.assert_allclose(read.points, CONTACTS.points, atol=1e-15)
    read = lis_grasp.load_contacts(1e3 * table[:, :3], unit="mm")
    np.testing.assert_allclose(read.points, CONTACTS.points)
    ours = lis_grasp.estimate(CONTACTS, "gpis").evaluate(POINTS)
    for source in (path, table):
        np.testing.assert_array_equal(lis_grasp.estimate(source, "gpis").evaluate(POINTS), ours)
    with pytest.raises(lis_grasp.exceptions.InvalidFileError, match=r"ndarray.*\(5, 4\)"):
        lis_grasp.load_contacts(np.zeros((5, 4)))
    for wrong in (None, 3j, object(), [[1.0], [2.0, 3.0]]):
        with pytest.raises(
            (TypeError, lis_grasp.exceptions.InvalidFileError), match="Contacts|N, 3"
        ):
            lis_grasp.load_contacts(wrong)


def test_a_table_of_pandas_is_contacts() -> None:
    pandas = pytest.importorskip("pandas")
    table = pandas.DataFrame(np.asarray(CONTACTS), columns=["x", "y", "z", "nx", "ny", "nz"])
    assert lis_grasp.load_contacts(table) == CONTACTS


def test_flags_of_other_programs_are_understood() -> None:
    words = "box --gripper wsg50 --n-touches=3 --mu 0.5 -o x --random-seed 4 --sim mujoco"
    ours = "box --hand wsg50 --touches=3 --friction 0.5 --output x --seed 4 --simulator mujoco"
    parse = build_parser("run").parse_args
    first, second = (vars(parse(["run", *text.split()])) for text in (words, ours))
    assert first == second
    parsed = build_parser("grasp").parse_args(["grasp", "a.ply", "--table", "0.1", "--top", "3"])
    assert (float(parsed.support), parsed.grasps) == (0.1, 3)


def test_a_flag_is_compared_without_its_dashes(capsys: pytest.CaptureFixture[str]) -> None:
    for flag, nearest in (("--gui", None), ("--frictions", "--friction"), ("--sead", "--seed")):
        with pytest.raises(SystemExit):
            build_parser("run").parse_args(["run", "box", flag])
        said = capsys.readouterr().err
        assert (f"'{nearest}'" in said) == (nearest is not None)
        assert ("did you mean" in said) == (nearest is not None)


def test_a_verb_is_found_by_another_word(tmp_path: Path) -> None:
    CONTACTS.save(tmp_path / "c.csv")
    where = ["--output", str(tmp_path / "x"), "--method", "gpis"]
    assert main(["reconstruct", str(tmp_path / "c.csv"), *where]) == 0
    assert (tmp_path / "x" / "surface.ply").is_file()
