"""Names of other libraries: what exists is answered, alike for classes, objects and options."""

import copy
import inspect
import pickle
import re
from configparser import ConfigParser
from contextlib import suppress
from functools import cached_property, partial
from pathlib import Path
from pkgutil import resolve_name
from typing import Any, Protocol

import numpy as np
import pytest
from made_grasps import jaw_grasp

import lis_grasp as lg
from lis_grasp import guesses
from lis_grasp.cli.main import build_parser, main
from lis_grasp.exceptions import InvalidMeshError, InvalidOptionError
from lis_grasp.guesses import KEYWORDS, Answering, advice_on_option, answers
from lis_grasp.robots.robot_model import RobotModel
from lis_grasp.surfaces.queries import Predicting

AXES = np.vstack([np.eye(3), -np.eye(3)])
CONTACTS_FILE = Path(__file__).parents[1] / "examples" / "contacts.csv"
CONTACTS = lg.Contacts(0.03 * AXES, AXES)
CLASSES: dict[str, Any] = {
    "Contacts": lg.Contacts,
    "Predicting": lg.LocalImplicitSurface,
    "Grasp": lg.Grasp,
    "GraspSearch": lg.GraspSearch,
    "RobotModel": lg.Hand,
    "Run": lg.Run,
    "Task": lg.Task,
    "Shape": lg.Shape,
    "Scene": lg.Scene,
}
# Names in answers that are no names of ours: variables, and functions of Python and numpy.
OTHER = {"contacts", "surface", "file", "folder", "len", "numpy", "hand", "table", "mesh", "search"}
BOX = lg.Body.box
VERBS = ("run", "explore", "next", "estimate", "grasp", "lift")


def _sections() -> dict[str, list[str]]:
    table = ConfigParser(delimiters=("<-",), interpolation=None)
    table.optionxform = str  # type: ignore[assignment, method-assign]
    table.read(Path(guesses.__file__).with_suffix(".ini"), encoding="utf-8")
    return {name: list(table[name]) for name in table.sections()}


def _flags(verb: str) -> set[str]:
    (verbs,) = (a.choices for a in build_parser(verb)._actions if isinstance(a.choices, dict))
    return {*re.findall(r"--[\w-]+", verbs[verb].format_help())}


FLAGS = {verb: _flags(verb) for verb in VERBS}


@pytest.mark.parametrize("section", ["lis_grasp", *CLASSES])
def test_answers_name_what_exists_and_get_asked_for_what_does_not(section: str) -> None:
    owner = CLASSES.get(section, lg)
    members = {*dir(owner), *getattr(owner, "__dataclass_fields__", ())}
    for answer in _sections()[section]:
        first = re.split(r"[^\w]+", answer.lstrip("`([").replace("lis-grasp ", "lg_"))[0]
        known = first in members or hasattr(lg, first) or first in {"grasp", *OTHER}
        assert known or answer.startswith("`lis-grasp "), answer
        for dotted in re.findall(r"\b(?:[A-Z]\w+|shapes|drake)\.\w+", answer):
            resolve_name(f"lis_grasp:{dotted}")
    assert not {*answers(section)} & members


def test_answers_on_options_name_options() -> None:
    flags = set().union(*FLAGS.values(), *map(_flags, ("outline", "compare")))
    keywords = {
        f"--{name}".replace("_", "-")
        for function in (lg.extract_mesh, lg.GaussianProcessImplicitSurface.from_contacts, BOX)
        for name in inspect.signature(function).parameters
    }
    for answer in _sections()["options"]:
        assert f"--{re.split('[,;]', answer)[0]}" in flags | keywords, answer
    assert not {f"--{name}" for name in answers("no option")} & set().union(*FLAGS.values())


@pytest.mark.parametrize(
    ("owner", "name", "answer"),
    [
        (lg.Contacts, "from_arrays", "Contacts(points, normals)"),
        (CONTACTS, "from_arrays", "Contacts(points, normals)"),
        (CONTACTS, "to_dataframe", "to_pandas()"),
        (lg.GaussianProcessImplicitSurface, "score", "surface_error"),
        (lg.estimate(CONTACTS, "gpis"), "score", "surface_error"),
        (lg.estimate(CONTACTS, "gpis"), "fit", "from_contacts"),
        (lg, "load_mesh", "shapes.find"),
        (lg.GraspSearch(()), "to_csv", "save"),
        (lg.Hand, "from_urdf", "Hand.load"),
        (lg.Task(), "to_yaml", "write_scene"),
        (lg.RunConfig(), "to_yaml", "write_scene"),
        (lg.shapes.box(), "vertices", "mesh.vertices"),
        (CONTACTS, "spacin", "did you mean 'spacing'"),
        (lg.Contacts, "spacin", "did you mean 'spacing'"),
        (lg, "load_contcts", "did you mean 'load_contacts'"),
    ],
)
def test_a_name_of_another_library_is_answered(owner: Any, name: str, answer: str) -> None:
    assert not hasattr(owner, name)
    with pytest.raises(AttributeError, match=f"no attribute '{name}': .*{re.escape(answer)}"):
        getattr(owner, name)


def test_a_property_raises_its_own_error_and_special_names_get_no_advice() -> None:
    class Broken(Answering):
        @cached_property
        def fit(self) -> None:
            raise AttributeError("no such file")

    with pytest.raises(AttributeError, match="^no such file$"):
        Broken().fit  # noqa: B018
    for owner in (Broken, Broken()):
        with pytest.raises(AttributeError, match=r"'_fit'$"):
            owner._fit  # noqa: B018


def test_classes_that_answer_are_copied_pickled_and_mixed_with_protocols() -> None:
    class Sized(Protocol):
        def size(self) -> int: ...

    class Own(Predicting, lg.ImplicitSurface, Sized):
        def size(self) -> int:
            return 1

    assert Own().size() == 1
    assert not hasattr(Own, "fit")
    assert isinstance(CONTACTS, lg.Contacts)
    assert not isinstance(CONTACTS, RobotModel)
    assert pickle.loads(pickle.dumps(CONTACTS)) == CONTACTS == copy.copy(CONTACTS)  # noqa: S301
    assert "points" in inspect.signature(lg.Contacts).parameters
    assert "kernel" in inspect.signature(lg.GaussianProcessImplicitSurface.from_contacts).parameters


@pytest.mark.parametrize(
    ("call", "word"),
    [
        (lambda: lg.run("box", output="x"), "folder"),
        (lambda: lg.run("box", out_dir="x"), "folder"),
        (lambda: lg.run("box", n_touches=5), "touches"),
        (lambda: lg.plan("box", support=0.0), "support_height"),
        (lambda: lg.plan("box", table=0.0), "support_height"),
        (lambda: lg.estimate(CONTACTS, support=0.0), "support_height"),
        (lambda: lg.next_touch(CONTACTS, support=0.0), "support_height"),
        (lambda: lg.explore("box", view="v.npz"), "views"),
        (lambda: lg.explore("box", clamped=True), "free=False"),
        (lambda: lg.explore("box", unknown=True), "known=False"),
        (lambda: lg.extract_mesh(None, voxel_size=1), "resolution"),  # type: ignore[call-arg, arg-type]
        (lambda: lg.shapes.box(extents=(1, 1, 1)), "size"),  # type: ignore[call-arg]
        (
            lambda: lg.LocalImplicitSurface.from_contacts(CONTACTS, noise=1.0),  # type: ignore[call-arg]
            "position_noise",
        ),
    ],
)
def test_a_keyword_of_the_command_line_or_another_library_gets_ours(call: Any, word: str) -> None:
    with pytest.raises(TypeError, match=rf"has no option|there is no option.*\b{word}\b") as error:
        call()
    assert re.search(rf"\b{word}\b", str(error.value)), error.value


@pytest.mark.parametrize(
    ("verb", "call"),
    [
        ("run", partial(lg.run, "box")),
        ("explore", partial(lg.explore, "box")),
        ("next", partial(lg.next_touch, CONTACTS)),
        ("estimate", partial(lg.estimate, CONTACTS)),
        ("grasp", partial(lg.plan, "box")),
        ("lift", partial(lg.lift, "box", "wsg50")),
    ],
)
def test_every_flag_is_a_keyword_or_gets_the_word_for_it(verb: str, call: Any) -> None:
    named = inspect.signature(call).parameters
    for keyword in {flag[2:].replace("-", "_") for flag in FLAGS[verb]} - {
        "help",
        "object",
        *named,
    }:
        with pytest.raises(TypeError) as error:
            call(**{keyword: None, "zzzz": None})  # the unknown option that is first in order
        if "'zzzz'" not in str(error.value):
            message = str(error.value)
            assert re.search(f"'{keyword}': (?!did you mean|it has)", message), message
    for flag, keyword in KEYWORDS.items():
        if f"--{flag}" in FLAGS[verb] and keyword.isidentifier():
            assert advice_on_option(f"--{keyword}", FLAGS[verb]) == f": use --{flag}"


@pytest.mark.parametrize(
    ("line", "answer"),
    [
        ("run box -o x", "use --output"),
        ("run box --folder x", "use --output"),
        ("grasp m.stl --support-height 0", "use --support"),
        ("grasp m.stl --top 3", "use --grasps"),
        ("run --object box x", "OBJECT is given without a flag"),
        ("grasp surface.ply wsg50", "use --hand wsg50"),
        ("doctor iiwa14", "use --arm iiwa14"),
        ("run box --position 0.1", "unrecognized arguments: --position"),
        ("run box --position 0 0 0", "use --at, the place in a world"),
        ("run box --view", "expected one argument: what a depth camera saw"),
        ("next contacts.ply --batch 3", "one probe is chosen at a time"),
        ("compare contacts.csv", "arguments without a flag are not taken"),
        ("grasp m.stl n.stl o.stl", "arguments without a flag are MESH"),
        ("estimate -", "standard input is not read; write it to a file"),
        (f"estimate {CONTACTS_FILE} --estimator mine.py:Rbf", "write mine:Rbf"),
        ("run box --headless", "without --watch"),
        ("run box --no-shake", "every lift ends with a shake"),
        ("run box --prober magic", "--prober must be one of dynamic, kinematic; it is 'magic'"),
        ("hand list", "lis-grasp run --help"),
        ("plot results", "lis-grasp view"),
        ("help run", "lis-grasp VERB --help"),
        ("runn box", "did you mean 'run'"),
        ("see --depth depth.npy", "IMAGE is given without a flag"),
        ("see depth.npy --intrinsics a.yaml", "use --camera, which names the file"),
    ],
)
def test_a_word_of_other_programs_is_answered(
    line: str, answer: str, capsys: pytest.CaptureFixture[str]
) -> None:
    with suppress(SystemExit):
        assert main(line.split()) == 2
    assert answer in capsys.readouterr().err


def test_a_message_on_a_member_lists_the_fields_too() -> None:
    with pytest.raises(AttributeError, match="it has contacts, ") as refused:
        _ = lg.Run.__new__(lg.Run).nothing_like_it
    assert {"contacts", "mesh", "grasps", "held"} <= set(re.findall(r"\w+", str(refused.value)))


def test_a_grasp_in_the_object_s_place_is_named() -> None:
    search = lg.plan("box", "wsg50", grasps=1)
    with pytest.raises(TypeError, match="needs the true object before the Grasp"):
        lg.lift(search.best)


MESH = lg.shapes.box(size=0.06).mesh
SURFACE = lg.estimate(CONTACTS, "gpis")
GRASPS = lg.GraspSearch(())


@pytest.mark.parametrize(
    ("call", "error", "said"),
    [
        (lambda: lg.plan(SURFACE), TypeError, r"write extract_mesh\(surface\)$"),
        (lambda: lg.plan(CONTACTS), TypeError, r"write extract_mesh\(estimate\(contacts\)\)$"),
        (lambda: lg.plan("box", MESH), TypeError, "a hand is a name.* of type Trimesh$"),
        (lambda: lg.explore("box", MESH), TypeError, "a hand is a name.* of type Trimesh$"),
        (lambda: lg.next_touch(SURFACE), TypeError, "give its contacts"),
        (lambda: lg.next_touch(MESH), TypeError, "contacts are read from a file"),
        (lambda: lg.lift("box", GRASPS), TypeError, "it is of type GraspSearch$"),
        (lambda: lg.lift("box", "wsg50", GRASPS), TypeError, "it is of type GraspSearch$"),
        (lambda: lg.lift("box", "wsg50"), TypeError, "it is missing$"),
        (lambda: CONTACTS.append(AXES), TypeError, r"append\(Contacts\(points, normals\)\)$"),
        (lambda: lg.Body.box("a", AXES, AXES[0]), InvalidOptionError, "sides must be 3 finite"),
        (lambda: lg.Body.box("a", AXES[0], np.eye(4)), InvalidOptionError, "center must be 3"),
        (lambda: lg.Body.box("a", -AXES[0], AXES[0]), InvalidOptionError, "sides must be above 0"),
        (lambda: lg.Body.box("a", (60, 60, 99), (0, 0, 30)), InvalidOptionError, "by 1000 if"),
        (lambda: lg.Body.box("a", AXES[0], pose=AXES[0]), TypeError, "use center$"),
    ],
)
def test_an_argument_of_another_type_is_answered(
    call: Any, error: type[Exception], said: str
) -> None:
    with pytest.raises(error, match=said):
        call()


@pytest.mark.parametrize("option", ["units", "up", "size"])
@pytest.mark.parametrize("solid", [MESH, lg.shapes.box(size=0.06)])
def test_an_option_of_files_is_refused_for_an_object_in_memory(solid: Any, option: str) -> None:
    value = {"units": "mm", "up": "y", "size": 0.06}[option]
    grasp = jaw_grasp(lg.Hand.load("wsg50"), np.zeros(3), 0.06)
    for call in (lg.plan, partial(lg.explore, prober="kinematic"), lg.lift):
        arguments = ("wsg50", *([grasp] if call is lg.lift else []))
        with pytest.raises(InvalidOptionError, match=f"^{option} is for .* in memory"):
            call(solid, *arguments, **{option: value})


@pytest.mark.parametrize(("scale", "unit"), [(1000.0, "mm"), (100.0, "cm")])
def test_a_mesh_in_memory_of_another_unit_is_told_its_scale(scale: float, unit: str) -> None:
    large = MESH.copy().apply_scale(scale)
    with pytest.raises(InvalidMeshError, match=rf"apply_scale\({1 / scale:g}\) if it is in {unit}"):
        lg.plan(large, "wsg50")


def test_the_next_touch_reads_what_an_estimate_reads() -> None:
    choose = partial(lg.next_touch, hand="wsg50", support_height=-0.03)
    touch, again = choose(CONTACTS), choose(np.asarray(CONTACTS))
    np.testing.assert_array_equal(touch.probe.target, again.probe.target)


@pytest.mark.parametrize(
    ("option", "value", "said"),
    [
        ("mass", "500 g", "a number in kg"),
        ("size", "80 mm", "a number in m"),
        ("max_seconds", "5 min", "a number in s"),
        ("friction", "50 %", "a number;"),
        ("estimator", 3, "a name, my.module:Class, or a function"),
        ("views", 3, "a list of texts"),
        ("cloud", np.eye(3), "the path of a file"),
        (
            "world",
            (lg.Body.box("a", AXES[3] + 1.1, AXES[0]),),
            "the path of a file or of type Surr",
        ),
        ("pose", np.eye(4), "a name or the path of a file"),
        ("hand", "", "a text that is not empty"),
    ],
)
def test_a_value_of_another_type_is_told_its_type_and_unit(
    option: str, value: Any, said: str
) -> None:
    with pytest.raises(InvalidOptionError, match=f"^{option} must be {said}"):
        lg.Task.of("box", **{option: value})


def _misuse(line: str, capsys: pytest.CaptureFixture[str]) -> str:
    with suppress(SystemExit):
        assert main(line.split()) == 2
    return capsys.readouterr().err


def test_a_switch_takes_no_value_and_has_no_opposite(capsys: pytest.CaptureFixture[str]) -> None:
    (verbs,) = (a.choices for a in build_parser("run")._actions if isinstance(a.choices, dict))
    switches = [
        a.option_strings[0] for a in verbs["run"]._actions if a.nargs == 0 and a.const is True
    ]
    assert {"--camera", "--unknown", "--fresh"} <= {*switches}
    for flag in switches:
        assert f"{flag} takes no value; it has '1'" in _misuse(f"run box {flag}=1", capsys)
        assert f": {flag} is off unless" in _misuse(f"run box --no-{flag[2:]}", capsys)
        assert f": {flag} takes no value" in _misuse(f"explore box {flag} a.yaml", capsys)


def test_values_beyond_one_units_and_assignments_are_answered(
    capsys: pytest.CaptureFixture[str],
) -> None:
    for flag, unit in (("--mass", "kg"), ("--size", "m"), ("--max-seconds", "s")):
        assert f"{flag} must be a number in {unit}; it is '5x'" in _misuse(
            f"explore box {flag} 5x", capsys
        )
        assert f": {flag} takes one value" in _misuse(f"explore box {flag} 1 2 3", capsys)
        name = flag[2:].replace("-", "_")
        for word in (f"{name}=5", f"+{name}=5", f"{flag[2:]}=5"):
            assert f"write {flag} 5 for {word};" in _misuse(f"run box {word}", capsys)
    said = _misuse("--hand wsg50 run box", capsys)
    assert "options come after VERB: write lis-grasp run before --hand" in said
