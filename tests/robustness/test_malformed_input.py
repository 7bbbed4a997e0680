"""Malformed input gives a valid result or a one-line error."""

from __future__ import annotations

import json
import math
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
import trimesh
import yaml
from cases import TESTS, check_answers
from readers import READERS, check_hand_file, refused_at_most, sphere_contacts, write_hand

from lis_grasp import Contacts, shapes
from lis_grasp.exceptions import (
    InvalidContactsError,
    InvalidFileError,
    InvalidHandError,
    InvalidMeshError,
    InvalidOptionError,
    LisGraspError,
    shown,
)
from lis_grasp.exploration import Observation, Probe, ProbeOutcome, TouchLog, load_outcomes
from lis_grasp.grasping.grasps import GraspSearch
from lis_grasp.io import provenance
from lis_grasp.io.provenance import parse
from lis_grasp.io.surface_files import load_surface
from lis_grasp.motion import Motion
from lis_grasp.results.page import scene_of
from lis_grasp.results.run_results import Run
from lis_grasp.robots.hand import Hand
from lis_grasp.robots.link_bodies import load_link_mesh
from lis_grasp.shapes.loading import load_obstacles
from lis_grasp.surfaces import ESTIMATORS, LocalImplicitSurface
from lis_grasp.surfaces.contact_loading import load_contacts
from lis_grasp_studies.study.study import load_study

every_estimator = pytest.mark.parametrize("name", list(ESTIMATORS))


@pytest.mark.parametrize("count", [1, pytest.param(8, marks=pytest.mark.slow)])
@pytest.mark.parametrize("kind", TESTS)
def test_malformed_input_gives_a_valid_result_or_an_error(kind: str, count: int) -> None:
    TESTS[kind](count=count)()


@pytest.mark.parametrize("kind", READERS)
def test_a_valid_file_is_read(kind: str, tmp_path: Path) -> None:
    READERS[kind].check(READERS[kind].write(tmp_path))


@pytest.mark.slow
@every_estimator
def test_a_hundred_thousand_contacts_are_taken(name: str) -> None:
    contacts = sphere_contacts(100_000, np.random.default_rng(0))
    with refused_at_most(180.0):
        surface = ESTIMATORS[name](contacts)
        check_answers(surface, contacts.points)
        return
    pytest.fail("the contacts were refused")


def test_the_limits_of_a_case_hold() -> None:
    with refused_at_most():
        raise InvalidFileError("no such thing")
    with pytest.raises(MemoryError), refused_at_most():
        np.ones(10**9)
    with pytest.raises(AssertionError), refused_at_most(0.0):
        np.linalg.det(np.eye(300))
    with pytest.raises(IndexError), refused_at_most():
        [][0]


@pytest.mark.parametrize(
    ("read", "name"),
    [
        *((Contacts.load, f"absent.{ending}") for ending in ("ply", "csv")),
        *((load_contacts, f"absent.{ending}") for ending in ("off", "xyz", "csv")),
        *((read, "absent.ply") for read in (load_surface, provenance.read, shapes.load)),
        *((load_outcomes, "absent.jsonl"), (shapes.load, "absent.stl")),
    ],
)
def test_a_missing_file_is_named(read: Callable[[Path], object], name: str, tmp_path: Path) -> None:
    with pytest.raises(InvalidFileError) as error:
        read(tmp_path / name)
    assert error.value.path == tmp_path / name


# Messages.


def test_a_message_is_one_short_line_whatever_it_names() -> None:
    message = str(LisGraspError("first\nsecond " + "x" * 10**6 + " and the cure"))
    assert message.startswith("first second")
    assert message.endswith("and the cure")
    assert len(message) < 1000
    assert "\n" not in message


def test_values_are_named_shortly_however_large() -> None:
    bomb: list[object] = ["x"] * 9
    for _ in range(12):
        bomb = [bomb] * 9
    assert len(shown(bomb)) < 10**6
    assert shown(16**100_000) == "a very long int"


# Contacts and estimators.


@pytest.mark.parametrize(
    "points", [[[1e8, 0, 0]], [[1e308, 0, 0]], [[1j, 0, 0]], [[10**400, 0, 0]]]
)
def test_points_far_beyond_the_earth_are_refused(points: list) -> None:
    with pytest.raises(InvalidContactsError) as error:
        Contacts(points, [[0.0, 0.0, 1.0]])
    assert error.value.field == "points"


def test_normals_whose_length_overflows_are_refused_without_a_warning() -> None:
    with pytest.raises(InvalidContactsError) as error:
        Contacts([[0.0, 0.0, 0.0]], [[1e200, 1e200, 0.0]])
    assert (error.value.field, error.value.row) == ("normals", 0)


@every_estimator
@pytest.mark.parametrize("option", ["position_noise", "normal_noise"])
def test_huge_options_are_refused(name: str, option: str) -> None:
    with pytest.raises(InvalidOptionError) as error:
        ESTIMATORS[name](sphere_contacts(9, np.random.default_rng(0)), **{option: 1e300})
    assert error.value.option == option


@every_estimator
def test_contacts_equal_up_to_rounding_give_finite_values(name: str) -> None:
    contacts = sphere_contacts(40, np.random.default_rng(3))
    place = np.array([30.0, -20.0, 10.0])
    surface = ESTIMATORS[name](Contacts(place + 1e-13 * contacts.points, contacts.normals))
    assert (surface.bounds[1] - surface.bounds[0] > 0.01).all()
    for answer in (surface.evaluate(place + 0.01), surface.gradient(place + 0.01)):
        assert np.isfinite(answer).all()


def test_the_gradient_on_a_contact_s_axis_is_finite() -> None:
    contacts = Contacts([[0.0, 0, 0], [50.0, 0, 0]], [[0.0, 0, 1], [1.0, 0, 0]])
    surface = LocalImplicitSurface.from_contacts(contacts)
    beside = 10.0 ** np.arange(-320, 0, 8)[:, None] * [1.0, 0.0, 0.0] + [0.0, 0.0, 5.0]
    assert np.isfinite(surface.gradient(beside)).all()


@pytest.mark.slow
def test_a_gaussian_process_takes_many_contacts() -> None:
    # The equations of all would take 8 GB.
    contacts = sphere_contacts(8000, np.random.default_rng(0))
    values = ESTIMATORS["gpis"](contacts).evaluate(contacts.points[::100])
    assert np.abs(values).max() < 1e-3 * contacts.extent


# Meshes.


def test_bodies_that_are_all_flat_are_refused(tmp_path: Path) -> None:
    sheet = trimesh.creation.box(extents=(0.1, 0.1, 0.0))
    other = sheet.copy()
    other.apply_translation([0.2, 0.0, 0.0])
    (sheet + other).export(tmp_path / "sheets.ply")
    with pytest.raises(InvalidMeshError):
        shapes.load(tmp_path / "sheets.ply")


def test_loose_triangles_are_refused_at_once(tmp_path: Path) -> None:
    mesh = trimesh.creation.icosphere(subdivisions=4, radius=0.05)
    corners = mesh.triangles.reshape(-1, 3)
    corners = corners + 1e-5 * np.random.default_rng(0).standard_normal(corners.shape)
    loose = trimesh.Trimesh(corners, np.arange(len(corners)).reshape(-1, 3), process=False)
    loose.export(tmp_path / "loose.ply")
    with pytest.raises(InvalidMeshError, match="5120 holes"):
        shapes.load(tmp_path / "loose.ply")


def test_huge_vertices_are_refused_without_a_warning(tmp_path: Path) -> None:
    (tmp_path / "a.obj").write_text("v 0 0 0\nv 1e308 0 0\nv 0 -1e308 0\nf 1 2 3\n")
    with pytest.raises(InvalidMeshError):
        shapes.load(tmp_path / "a.obj")


def test_a_vertex_without_faces_is_ignored(tmp_path: Path) -> None:
    box = trimesh.creation.box(extents=(0.1, 0.1, 0.1))
    lines = [f"v {x} {y} {z}" for x, y, z in [*box.vertices.tolist(), [1e308, -1e308, 1e308]]]
    lines += [f"f {a} {b} {c}" for a, b, c in (box.faces + 1).tolist()]
    (tmp_path / "box.obj").write_text("\n".join(lines))
    shape = shapes.load(tmp_path / "box.obj")
    assert shape.mesh.volume == pytest.approx(1e-3)
    assert not shape.repairs


def test_obstacles_with_vertices_that_are_no_numbers_are_refused(tmp_path: Path) -> None:
    path = tmp_path / "table.obj"
    path.write_text("v 0 0 0\nv 1 0 0\nv 0 1 0\nv 1e308 nan 0\nf 1 2 3\n")
    assert load_obstacles(path).bounds == pytest.approx(np.array([[0, 0, 0], [1, 1, 0]]))
    path.write_text(path.read_text().replace("f 1", "f 4"))
    with pytest.raises(InvalidMeshError):
        load_obstacles(path)


# Hands.


def hand_files(folder: Path, group: str) -> tuple[Path, Path]:
    model = write_hand(folder, "wsg50" if group == "urdf" else "claw")
    return model.with_suffix(".yaml"), model


@pytest.mark.parametrize(
    ("group", "old", "new", "message"),
    [
        ("urdf", '<sphere radius="0.006"/>', '<sphere radius="-1"/>', "sizes of 1e-06"),
        ("urdf", '<sphere radius="0.006"/>', '<sphere radius="nan"/>', "sizes of 1e-06"),
        ("urdf", '<sphere radius="0.006"/>', '<sphere radius="1e-300"/>', "sizes of 1e-06"),
        ("urdf", 'size="0.012 0.0215 0.069"', 'size="0.012 0.0215"', "not a URDF|3 sizes of 1e-06"),
        ("urdf", '<mass value="1.032"/>', '<mass value="nan"/>', "finite moments"),
        ("urdf", 'ixx="6.628e-04"', 'ixx="inf"', "finite moments"),
        ("urdf", '<origin xyz="0 0 -0.03625"/>', '<origin xyz="0 nan 0"/>', "must be finite"),
        ("urdf", '<sphere radius="0.006"/>', "", "'left_tip' lacks a shape in <geometry>"),
        ("urdf", "body.stl", "a" * 5000, "is no file"),
        ("sdf", "<mass>0.2</mass>", "<mass>inf</mass>", "finite moments"),
        ("sdf", "<pose>-0.03 0", "<pose>inf 0", "must have finite numbers"),
        ("sdf", "<xyz>0 1 0</xyz>", "<xyz>inf 1 0</xyz>", "an axis of three numbers"),
        ("sdf", 'multiplier="0.5"', 'multiplier=".nan"', "numbers were expected"),
    ],
)
def test_invalid_numbers_in_a_hand_are_refused(
    group: str, old: str, new: str, message: str, tmp_path: Path
) -> None:
    hand, model = hand_files(tmp_path, group)
    text = model.read_text()
    assert old in text
    model.write_text(text.replace(old, new))
    with pytest.raises(InvalidHandError, match=message):
        Hand.load(hand)


@pytest.mark.parametrize(
    ("scale", "message"),
    [
        ("inf 1 1", "1 or 3 finite numbers other than 0"),
        ("1 0 1", "1 or 3 finite numbers other than 0"),
        ("1 2", "1 or 3 finite numbers other than 0"),
        ("1 1 1e300", "within 1000 m"),
    ],
)
def test_an_invalid_mesh_scale_is_refused(scale: str, message: str, tmp_path: Path) -> None:
    trimesh.creation.box(extents=(0.1, 0.1, 0.1)).export(tmp_path / "body.stl")
    assert load_link_mesh(tmp_path / "body.stl", [0.5, 1.0, -2.0]).extents == pytest.approx(
        [0.05, 0.1, 0.2]
    )
    with pytest.raises(InvalidHandError, match=message):
        load_link_mesh(tmp_path / "body.stl", [float(word) for word in scale.split()])


@pytest.mark.parametrize("group", ["urdf", "sdf"])
@pytest.mark.parametrize(
    ("content", "named"),
    [
        ('<!DOCTYPE r [<!ENTITY a "ha">]><robot name="&a;"/>', "entities"),
        ('<!DOCTYPE r [<!ENTITY a SYSTEM "file:///etc/passwd">]><r>&a;</r>', "entities"),
        ("<a>" * 100_000, "XML"),
        ("<robot", "XML"),
    ],
)
def test_xml_with_entities_or_deep_nesting_is_refused(
    group: str, content: str, named: str, tmp_path: Path
) -> None:
    hand, model = hand_files(tmp_path, group)
    model.write_text(content)
    with pytest.raises(InvalidHandError, match=named) as error:
        Hand.load(hand)
    assert (error.value.file, error.value.key) == (hand.name, "urdf")


@pytest.mark.parametrize(
    "content",
    [
        "[" * 500,
        "name: " + "9" * 5000,
        "name: 2001-99-99",
    ],
)
def test_yaml_that_cannot_be_parsed_is_refused(content: str, tmp_path: Path) -> None:
    path = tmp_path / "hand.yaml"
    path.write_text(content)
    with pytest.raises(InvalidHandError) as error:
        Hand.load(path)
    assert (error.value.file, error.value.key) == (path.name, "")
    with pytest.raises(InvalidFileError) as error:
        load_study(path)
    assert error.value.path == path


@pytest.mark.parametrize("number", [10**400, 1e308, math.inf])
def test_an_overflowing_direction_is_refused(number: float, tmp_path: Path) -> None:
    hand, _ = hand_files(tmp_path, "urdf")
    content = yaml.safe_load(hand.read_text())
    content["approach"] = [0, 0, number]
    hand.write_text(yaml.safe_dump(content))
    with pytest.raises(InvalidHandError) as error:
        Hand.load(hand)
    assert error.value.key == "approach[2]"


@pytest.mark.parametrize("number", [0.0, 5e-324, 1e-170])
def test_a_direction_whose_length_underflows_is_refused(number: float, tmp_path: Path) -> None:
    hand, _ = hand_files(tmp_path, "urdf")
    content = yaml.safe_load(hand.read_text())
    hand.write_text(yaml.safe_dump(content | {"approach": [0, 0, number]}))
    with pytest.raises(InvalidHandError) as error:
        Hand.load(hand)
    assert error.value.key == "approach"


def _write(content: str) -> Callable[[Path], None]:
    return lambda file: file.write_text(content, encoding="utf-8") and None


def _replace(old: str, new: str) -> Callable[[Path], None]:
    def act(file: Path) -> None:
        text = file.read_text()
        file.write_text(text.replace(old, new, 1))

    return act


def _entities(depth: int) -> str:
    """Return XML that grows tenfold with every level of its entities."""
    levels = "".join(f'<!ENTITY e{i} "{f"&e{i - 1};" * 10 if i else "ha"}">' for i in range(depth))
    return f'<?xml version="1.0"?><!DOCTYPE r [{levels}]><robot name="&e{depth - 1};"/>'


_LONG_ENTITY = (
    f'<?xml version="1.0"?><!DOCTYPE r [<!ENTITY e "{"ha" * 40_000}">]>'
    f'<robot name="r"><link name="{"&e;" * 80_000}"/></robot>'
)
_FILE_ENTITY = (
    '<?xml version="1.0"?><!DOCTYPE r [<!ENTITY e SYSTEM "file:///etc/passwd">]>'
    '<robot name="r"><link name="a">&e;</link></robot>'
)
# Nested aliases: a few hundred bytes that expand to 9^11 words.
_ALIASES = ", ".join(
    ["&a0 [x, x, x, x, x, x, x, x, x]"]
    + [f"&a{i} [{', '.join([f'*a{i - 1}'] * 9)}]" for i in range(1, 12)]
)


def _without_meshes(file: Path) -> None:
    (file.parent / "body.stl").unlink()


def _empty_mesh(file: Path) -> None:
    (file.parent / "body.stl").write_bytes(b"")


def _torn_mesh(file: Path) -> None:
    mesh = file.parent / "body.stl"
    mesh.write_bytes(mesh.read_bytes()[:200])


def _without_model(file: Path) -> None:
    for model in [*file.parent.glob("*.urdf"), *file.parent.glob("*.sdf")]:
        model.unlink()


def _aliased(key: str) -> Callable[[Path], None]:
    """Give a key of the YAML a value that expands to an enormous list."""

    def act(file: Path) -> None:
        content = yaml.safe_load(file.read_text())
        content.pop(key)
        file.write_text(yaml.safe_dump(content) + f"{key}: [{_ALIASES}]\n")

    return act


_XML, _BOTH, _TEXT = ("urdf", "sdf"), ("urdf", "sdf", "yaml"), ("yaml",)
_SPECIAL: dict[str, tuple[tuple[str, ...], Callable[[Path], None]]] = {
    "no file of its mesh": (_BOTH, _without_meshes),
    "an empty file as its mesh": (_BOTH, _empty_mesh),
    "a torn mesh": (_BOTH, _torn_mesh),
    "a mesh outside of its folder": (_XML, _replace("body.stl", "../../../../../../etc/passwd")),
    "a mesh at the root": (_XML, _replace("body.stl", "file:///etc/passwd")),
    "a mesh that is a device": (_XML, _replace("body.stl", "/dev/zero")),
    "a mesh that is its folder": (_XML, _replace("body.stl", ".")),
    "a mesh from the net": (_XML, _replace("body.stl", "https://localhost:1/body.stl")),
    "a mesh of a package above": (_XML, _replace("body.stl", "package://../../etc/passwd")),
    "a mesh whose name has a zero byte": (_XML, _replace("body.stl", "a%00.stl")),
    "a mesh with a very long name": (_XML, _replace("body.stl", "a" * 5000)),
    "a mesh turned inside out": (_XML, _replace("1 1 1", "-1 1 1")),
    "a mesh without size": (_XML, _replace("1 1 1", "0 0 0")),
    "an entity bomb": (_XML, _write(_entities(12))),
    "a small entity bomb": (_XML, _write(_entities(5))),
    "one long entity": (_XML, _write(_LONG_ENTITY)),
    "an entity of a file": (_XML, _write(_FILE_ENTITY)),
    "no actuators": (_XML, _replace('type="', 'type="fixed" was="')),
    "nothing in it": (_BOTH, _write("")),
    "another root": (_XML, _write("<html><body/></html>")),
    "a robot without anything": (_XML, _write('<robot name="r"/>')),
    "a deep tree": (_XML, _write("<robot name='r'>" + "<a>" * 100_000)),
    "no URDF": (_TEXT, _without_model),
    "aliases that multiply, at the top": (_TEXT, _write(f"[{_ALIASES}]")),
    "aliases that multiply, as joints": (_TEXT, _aliased("joints")),
    "aliases that multiply, as name": (_TEXT, _aliased("name")),
    "aliases that multiply, as pads": (_TEXT, _aliased("pads")),
    "aliases that multiply, as approach": (_TEXT, _aliased("approach")),
    "itself in itself": (_TEXT, _write("&a {name: *a, kind: *a, pads: [*a]}")),
    "a tag of Python": (_TEXT, _write("!!python/object/apply:os.system ['true']")),
    "a list at the top": (_TEXT, _write("- a\n- b\n")),
    "a URDF outside": (_TEXT, _replace("urdf: ", "urdf: ../../../../../../etc/passwd #")),
}


@pytest.mark.parametrize(
    ("group", "change"),
    [(group, name) for name, (groups, _) in _SPECIAL.items() for group in groups],
)
def test_a_hostile_hand_is_read_or_refused(group: str, change: str, tmp_path: Path) -> None:
    kind = "claw" if group == "sdf" else "wsg50"
    model = write_hand(tmp_path, kind)
    _SPECIAL[change][1](model.with_suffix(".yaml") if group == "yaml" else model)
    with refused_at_most():
        check_hand_file(model)


# Files.


@pytest.mark.parametrize("content", ["", "[]", "[" * 10**5, '{"lift": {}}', '{"lift": [9]}'])
def test_a_damaged_report_is_named(content: str, tmp_path: Path) -> None:
    path = READERS["report.json of a run"].write(tmp_path)
    path.write_text(content)
    with pytest.raises(InvalidFileError) as error:
        Run.load(tmp_path)
    assert error.value.path == path


@pytest.mark.parametrize("key", ["surface", "exploration", "attempts", "lift"])
def test_a_page_says_which_report_lacks_what_it_shows(key: str, tmp_path: Path) -> None:
    path = READERS["report.json of a run"].write(tmp_path)
    path.write_text(json.dumps(json.loads(path.read_text()) | {key: {} if key == "lift" else []}))
    with pytest.raises(InvalidFileError) as error:
        scene_of(tmp_path)
    assert error.value.path == path


def test_a_huge_cell_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "contacts.csv"
    path.write_text("x,y,z,nx,ny,nz\n" + "1" * 200_000 + ",0,0,0,0,1\n")
    with pytest.raises(InvalidFileError) as error:
        Contacts.load(path)
    assert error.value.path == path


@pytest.mark.parametrize("step", [5, pytest.param(1, marks=pytest.mark.slow)])
def test_a_flipped_bit_in_a_motion_is_refused_or_harmless(step: int, tmp_path: Path) -> None:
    path = tmp_path / "motion.npz"
    Motion(np.arange(2.0), {"object": np.tile(np.eye(4), (2, 1, 1))}).save(path)
    whole = path.read_bytes()
    for place in range(0, len(whole), step):
        path.write_bytes(whole[:place] + bytes([whole[place] ^ 0x10]) + whole[place + 1 :])
        try:
            Motion.load(path)
        except InvalidFileError:
            continue


@pytest.mark.parametrize(
    ("name", "value"),
    [("reason", 3), ("moved", "far"), ("moved", math.nan), ("duration", 10**400), ("fingers", [3])],
)
def test_a_log_of_other_values_is_refused(name: str, value: object, tmp_path: Path) -> None:
    path = tmp_path / "touches.jsonl"
    contacts = sphere_contacts(1, np.random.default_rng(0))
    probe = Probe(np.zeros(3), np.array([0.0, 0.0, 1.0]), 0.1, 0.1)
    TouchLog(path, {}).append(Observation(ProbeOutcome(probe, "touched", contacts)))
    header, row = path.read_text().splitlines()
    path.write_text(f"{header}\n{json.dumps(json.loads(row) | {name: value})}\n")
    with pytest.raises(InvalidFileError) as error:
        load_outcomes(path)
    assert error.value.path == path
    assert error.value.field.split("[")[0] == name


@pytest.mark.parametrize("line", ["{", "[]", "7", "[" * 200_000, '{"a": ' + "9" * 5000 + "}"])
def test_the_damaged_line_of_a_log_is_named(line: str, tmp_path: Path) -> None:
    path = READERS["touches.jsonl"].write(tmp_path)
    rows = path.read_text().splitlines()
    path.write_text("\n".join([*rows[:3], line, *rows[4:]]) + "\n")
    with pytest.raises(InvalidFileError, match="line 4 "):
        load_outcomes(path)


@pytest.mark.parametrize("line", ["[" * 200_000, '{"a": ' + "9" * 5000 + "}"])
def test_json_that_cannot_be_parsed_is_refused(line: str, tmp_path: Path) -> None:
    path = tmp_path / "touches.jsonl"
    path.write_text(line + "\n")
    with pytest.raises(InvalidFileError) as error:
        load_outcomes(path)
    assert error.value.path == path
    assert parse("lis_grasp " + line) == {}
    grasps = tmp_path / "grasps.json"
    grasps.write_text(line)
    with pytest.raises(InvalidFileError) as error:
        GraspSearch.load(grasps)
    assert error.value.path == grasps
    contacts = tmp_path / "contacts.ply"
    Contacts([[0.0, 0.0, 0.0]], [[0.0, 0.0, 1.0]], fingers=("thumb",)).save(contacts)
    text = contacts.read_text()
    assert '["thumb"]' in text
    contacts.write_text(text.replace('["thumb"]', line))
    with pytest.raises(InvalidFileError) as error:
        Contacts.load(contacts)
    assert error.value.path == contacts
