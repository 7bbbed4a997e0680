"""Fuzzing: malformed input gives a valid result or a one-line error; laws hold for any contacts."""

from __future__ import annotations

import json
import math
import warnings
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
import trimesh
import yaml
from fuzzing.cases import Case, Kind, require, verdict_of
from fuzzing.hand_cases import write_hand
from fuzzing.kinds import KINDS
from fuzzing.workers import run_cases, run_one
from hypothesis import given, settings
from hypothesis import strategies as st
from random_directions import random_directions
from scipy.spatial import cKDTree
from scipy.spatial.transform import Rotation

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
from lis_grasp.exploration import Probe, ProbeOutcome, TouchLog, load_outcomes
from lis_grasp.grasping.grasps import GraspSearch
from lis_grasp.io.provenance import parse
from lis_grasp.io.surface_files import load_surface, save_surface
from lis_grasp.meshing import extract_mesh
from lis_grasp.motion import Motion
from lis_grasp.robots.hand import Hand
from lis_grasp.robots.link_bodies import load_mesh
from lis_grasp.shapes.mesh_distance import distances_to_mesh
from lis_grasp.surfaces import ESTIMATORS, LocalImplicitSurface
from lis_grasp_studies.study.study import load_study

every_estimator = pytest.mark.parametrize("name", list(ESTIMATORS))


# The first four cases of contacts have 100 000 contacts: only tests/robustness/fuzz.py runs them.
@pytest.mark.parametrize(
    ("kind", "cases"),
    [
        ("contacts", range(4, 24)),
        ("meshes", range(8)),
        ("hands", range(24)),
        ("files", range(32)),
        ("logs", range(32)),
    ],
)
def test_malformed_input_gives_a_valid_result_or_an_error(
    kind: str, cases: range, tmp_path: Path
) -> None:
    for index in cases:
        folder = tmp_path / str(index)
        folder.mkdir()
        result = run_one(kind, 7, index, folder)
        assert not result.verdict.startswith("failed"), result


@pytest.mark.slow
@pytest.mark.parametrize(
    ("kind", "count"), [("contacts", 200), ("meshes", 100), ("hands", 200), ("files", 200)]
)
def test_much_malformed_input_gives_valid_results_or_errors(kind: str, count: int) -> None:
    jobs = [(kind, 11, index) for index in range(4, 4 + count)]
    failed = [r for r in run_cases(jobs, 2) if r.verdict.startswith("failed")]
    assert not failed


def test_equal_seeds_make_equal_cases(tmp_path: Path) -> None:
    for kind in KINDS:
        texts = set()
        for name in ("a", "b"):
            folder = tmp_path / kind / name
            folder.mkdir(parents=True)
            rng = np.random.default_rng([3, 5])
            texts.add(KINDS[kind].make(KINDS[kind].groups[1], 9, rng, folder).text)
        assert len(texts) == 1


def _refuse() -> None:
    raise InvalidFileError("no such thing")


def _warn() -> None:
    warnings.warn("overflow", RuntimeWarning, stacklevel=1)


@pytest.mark.parametrize(
    ("check", "sound", "verdict"),
    [
        (lambda: None, True, "accepted"),
        (_refuse, False, "refused InvalidFileError"),
        (_refuse, True, "failed SoundInputRefused"),
        (lambda: [][0], False, "failed IndexError"),
        (lambda: require(False, "finite"), False, "failed WrongResultError"),
        (_warn, False, "failed RuntimeWarning"),
    ],
)
def test_a_verdict_names_the_result_of_the_check(
    check: Callable[[], None], sound: bool, verdict: str
) -> None:
    assert verdict_of(Case("", check, sound))[0] == verdict


def test_groups_take_turns() -> None:
    kind = Kind(("a", "b"), lambda *_: Case("", lambda: None))
    assert [kind.group(i) for i in range(4)] == ["a", "b", "a", "b"]


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
    with pytest.raises(InvalidOptionError, match=f"{option} must be at least 0 and at most"):
        ESTIMATORS[name](sphere(9, np.random.default_rng(0)), **{option: 1e300})


@every_estimator
def test_contacts_equal_up_to_rounding_give_finite_values(name: str) -> None:
    contacts = sphere(40, np.random.default_rng(3))
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


def test_a_gaussian_process_takes_many_contacts() -> None:
    contacts = sphere(20_000, np.random.default_rng(0))
    values = ESTIMATORS["gpis"](contacts).evaluate(contacts.points[::100])
    assert np.abs(values).max() < 1e-3 * contacts.extent


# Meshes.


def test_bodies_that_are_all_flat_are_refused(tmp_path: Path) -> None:
    sheet = trimesh.creation.box(extents=(0.1, 0.1, 0.0))
    other = sheet.copy()
    other.apply_translation([0.2, 0.0, 0.0])
    (sheet + other).export(tmp_path / "sheets.ply")
    with pytest.raises(InvalidMeshError, match="encloses no volume"):
        shapes.load(tmp_path / "sheets.ply")


def test_loose_triangles_are_refused_at_once(tmp_path: Path) -> None:
    mesh = trimesh.creation.icosphere(subdivisions=4, radius=0.05)
    corners = mesh.triangles.reshape(-1, 3)
    corners = corners + 1e-5 * np.random.default_rng(0).standard_normal(corners.shape)
    loose = trimesh.Trimesh(corners, np.arange(len(corners)).reshape(-1, 3), process=False)
    loose.export(tmp_path / "loose.ply")
    with pytest.raises(InvalidMeshError, match="5120 holes, as loose triangles do"):
        shapes.load(tmp_path / "loose.ply")


def test_huge_vertices_are_refused_without_a_warning(tmp_path: Path) -> None:
    (tmp_path / "a.obj").write_text("v 0 0 0\nv 1e308 0 0\nv 0 -1e308 0\nf 1 2 3\n")
    with pytest.raises(InvalidMeshError, match="no finite numbers, or far beyond"):
        shapes.load(tmp_path / "a.obj")


def test_a_vertex_without_faces_is_ignored(tmp_path: Path) -> None:
    box = trimesh.creation.box(extents=(0.1, 0.1, 0.1))
    lines = [f"v {x} {y} {z}" for x, y, z in [*box.vertices.tolist(), [1e308, -1e308, 1e308]]]
    lines += [f"f {a} {b} {c}" for a, b, c in (box.faces + 1).tolist()]
    (tmp_path / "box.obj").write_text("\n".join(lines))
    shape = shapes.load(tmp_path / "box.obj")
    assert shape.mesh.volume == pytest.approx(1e-3)
    assert not shape.repairs


# Hands.


def hand_files(folder: Path, group: str) -> tuple[Path, Path]:
    # The seed chooses the jaw for a URDF.
    return write_hand(folder, group, np.random.default_rng(1))


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
        ("urdf", '<sphere radius="0.006"/>', "", "not a URDF that can be read"),
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
    assert load_mesh(tmp_path / "body.stl", [0.5, 1.0, -2.0]).extents == pytest.approx(
        [0.05, 0.1, 0.2]
    )
    with pytest.raises(InvalidHandError, match=message):
        load_mesh(tmp_path / "body.stl", [float(word) for word in scale.split()])


@pytest.mark.parametrize("group", ["urdf", "sdf"])
@pytest.mark.parametrize(
    ("content", "message"),
    [
        ('<!DOCTYPE r [<!ENTITY a "ha">]><robot name="&a;"/>', "must not declare XML entities"),
        ('<!DOCTYPE r [<!ENTITY a SYSTEM "file:///etc/passwd">]><r>&a;</r>', "must not declare"),
        ("<a>" * 100_000, "not valid XML"),
        ("<robot", "not valid XML"),
    ],
)
def test_xml_with_entities_or_deep_nesting_is_refused(
    group: str, content: str, message: str, tmp_path: Path
) -> None:
    hand, model = hand_files(tmp_path, group)
    model.write_text(content)
    with pytest.raises(InvalidHandError, match=message):
        Hand.load(hand)


@pytest.mark.parametrize(
    ("content", "message"),
    [
        ("[" * 500, "cannot be read as YAML"),
        ("name: " + "9" * 5000, "cannot be read as YAML"),
        ("name: 2001-99-99", "cannot be read as YAML"),
    ],
)
def test_yaml_that_cannot_be_parsed_is_refused(content: str, message: str, tmp_path: Path) -> None:
    path = tmp_path / "hand.yaml"
    path.write_text(content)
    with pytest.raises(InvalidHandError, match=message):
        Hand.load(path)
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


# Files.


def test_a_huge_cell_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "contacts.csv"
    path.write_text("x,y,z,nx,ny,nz\n" + "1" * 200_000 + ",0,0,0,0,1\n")
    with pytest.raises(InvalidFileError, match="cannot be read as CSV"):
        Contacts.load(path)


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
    contacts = sphere(1, np.random.default_rng(0))
    probe = Probe(np.zeros(3), np.array([0.0, 0.0, 1.0]), 0.1, 0.1)
    TouchLog(path, {}).append(ProbeOutcome(probe, "touched", contacts))
    header, row = path.read_text().splitlines()
    path.write_text(f"{header}\n{json.dumps(json.loads(row) | {name: value})}\n")
    with pytest.raises(InvalidFileError, match="no valid probe in line 2"):
        load_outcomes(path)


@pytest.mark.parametrize("line", ["[" * 200_000, '{"a": ' + "9" * 5000 + "}"])
def test_json_that_cannot_be_parsed_is_refused(line: str, tmp_path: Path) -> None:
    path = tmp_path / "touches.jsonl"
    path.write_text(line + "\n")
    with pytest.raises(InvalidFileError, match="one JSON object a line"):
        load_outcomes(path)
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
    with pytest.raises(InvalidFileError, match="list of names"):
        Contacts.load(contacts)


# Laws, for any contacts.

seeds = st.integers(0, 2**32 - 1)
few = settings(max_examples=4, deadline=None, derandomize=True)


def sphere(count: int, rng: np.random.Generator) -> Contacts:
    normals = random_directions(count, rng)
    return Contacts(0.05 * normals, normals)


def lumpy(rng: np.random.Generator) -> tuple[Contacts, np.ndarray]:
    """Return contacts of a rotated ellipsoid with a flat foot, and query points about it."""
    count = int(rng.integers(5, 40))
    u = random_directions(count, rng)
    axes = rng.uniform(0.03, 0.08, 3)
    points, normals = axes * u, u / axes
    foot = points[:, 2] < -0.4 * axes[2]
    points[foot, 2] = -0.4 * axes[2]
    normals[foot] = [0.0, 0.0, -1.0]
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    turn = Rotation.random(rng=rng).as_matrix()
    queries = rng.uniform(-0.1, 0.1, (30, 3))
    return Contacts(points @ turn.T, normals @ turn.T), queries


@every_estimator
@few
@given(seed=seeds)
def test_the_surface_moves_with_any_rigid_motion_and_scale(name: str, seed: int) -> None:
    rng = np.random.default_rng(seed)
    contacts, queries = lumpy(rng)
    R, p, s = Rotation.random(rng=rng).as_matrix(), rng.uniform(-0.5, 0.5, 3), rng.uniform(0.1, 10)
    still = ESTIMATORS[name](contacts)
    moved = ESTIMATORS[name](Contacts(s * contacts.points @ R.T + p, contacts.normals @ R.T))
    there = s * queries @ R.T + p
    # Rounding of coordinates, as amplified by the equations of the Gaussian process.
    loose = {"rtol": 1e-5, "atol": 1e-6 * s}
    np.testing.assert_allclose(moved.evaluate(there), s * still.evaluate(queries), **loose)
    if name in ("lis", "gpis"):  # that of patches jumps where two of them meet
        # It is capped by the diagonal of the bounds, which are parallel to the axes.
        caps = [s * np.linalg.norm(np.ptp(still.bounds, axis=0))]
        caps.append(np.linalg.norm(np.ptp(moved.bounds, axis=0)))
        for uncertainty, expected in zip(
            moved.uncertainty(there), s * still.uncertainty(queries), strict=True
        ):
            if max(uncertainty, expected) < min(caps):
                np.testing.assert_allclose(uncertainty, expected, **loose)


@pytest.mark.slow
@every_estimator
@settings(max_examples=3, deadline=None, derandomize=True)
@given(seed=seeds)
def test_the_mesh_moves_with_any_rigid_motion_and_scale(name: str, seed: int) -> None:
    rng = np.random.default_rng(seed)
    contacts, _ = lumpy(rng)
    R, p, s = Rotation.random(rng=rng).as_matrix(), rng.uniform(-0.5, 0.5, 3), rng.uniform(0.1, 10)
    moved_contacts = Contacts(s * contacts.points @ R.T + p, contacts.normals @ R.T)
    cube, cell = np.array([[-0.12] * 3, [0.12] * 3]), 0.004
    still = extract_mesh(ESTIMATORS[name](contacts), bounds=cube, resolution=cell)
    moved = extract_mesh(ESTIMATORS[name](moved_contacts), bounds=s * cube + p, resolution=s * cell)
    # The grid and the bounds do not rotate; the bounds close the surface far from all contacts.
    near = cKDTree(contacts.points).query(still.vertices)[0] < 0.02
    apart, _ = distances_to_mesh(s * still.vertices[near] @ R.T + p, moved)
    apart /= s * cell
    assert np.quantile(apart, 0.95) < 0.1
    assert apart.max() < 0.7  # at edges


@every_estimator
@few
@given(seed=seeds)
def test_any_order_of_contacts_gives_the_same_surface(name: str, seed: int) -> None:
    rng = np.random.default_rng(seed)
    contacts, queries = lumpy(rng)
    shuffled = contacts.subset(rng.permutation(len(contacts)))
    first, second = ESTIMATORS[name](contacts), ESTIMATORS[name](shuffled)
    np.testing.assert_allclose(
        first.evaluate(queries), second.evaluate(queries), rtol=1e-6, atol=1e-9
    )


@every_estimator
@few
@given(seed=seeds)
def test_any_gradient_is_the_slope_of_the_values(name: str, seed: int) -> None:
    rng = np.random.default_rng(seed)
    contacts, queries = lumpy(rng)
    surface = ESTIMATORS[name](contacts)
    way, step = rng.standard_normal(3), 1e-7
    way /= np.linalg.norm(way)
    ahead, here, behind = (surface.evaluate(queries + k * step * way) for k in (1, 0, -1))
    one, other = (ahead - here) / step, (here - behind) / step
    slopes = surface.gradient(queries) @ way
    # Between both one-sided slopes, which differ at a kink, and by curvature times the step.
    slack = 1e-4 * (1.0 + np.abs(slopes)) + np.abs(one - other)
    assert (slopes <= np.maximum(one, other) + slack).all()
    assert (slopes >= np.minimum(one, other) - slack).all()


# File round trips, for any numbers.

lengths = st.floats(-1e6, 1e6, allow_nan=False, allow_subnormal=True)
rows_of_three = st.lists(st.tuples(lengths, lengths, lengths), min_size=3, max_size=8)


@settings(max_examples=10, deadline=None, derandomize=True)
@given(rows=rows_of_three, uncertainty=st.floats(0.0, 1e6))
def test_any_saved_surface_loads_unchanged(
    tmp_path_factory: pytest.TempPathFactory, rows: list, uncertainty: float
) -> None:
    faces = [[0, 1, 2]]
    attributes = {"uncertainty": np.full(len(rows), uncertainty)}
    mesh = trimesh.Trimesh(rows, faces, process=False, vertex_attributes=attributes)
    path = tmp_path_factory.mktemp("any") / "surface.ply"
    save_surface(mesh, path)
    again = load_surface(path)
    np.testing.assert_array_equal(again.vertices, np.array(rows, dtype=float))
    np.testing.assert_array_equal(again.vertex_attributes["uncertainty"], uncertainty)


@settings(max_examples=10, deadline=None, derandomize=True)
@given(seed=seeds, standoff=st.floats(0, 1e3), moved=st.floats(0, 1e3), reason=st.text(max_size=9))
def test_any_logged_probe_loads_unchanged(
    tmp_path_factory: pytest.TempPathFactory,
    seed: int,
    standoff: float,
    moved: float,
    reason: str,
) -> None:
    rng = np.random.default_rng(seed)
    probe = Probe(rng.standard_normal(3), rng.standard_normal(3), standoff, 0.1)
    contacts = sphere(int(rng.integers(1, 4)), rng)
    outcome = ProbeOutcome(probe, "touched", contacts, reason=reason, moved=moved)
    path = tmp_path_factory.mktemp("any") / "touches.jsonl"
    TouchLog(path, {"seed": seed}).append(outcome)
    (again,) = TouchLog(path, {"seed": seed}).resume()
    np.testing.assert_array_equal(again.contacts.points, contacts.points)
    np.testing.assert_array_equal(again.probe.direction, probe.direction)
    assert (again.probe.standoff, again.moved, again.reason) == (standoff, moved, reason)


@settings(max_examples=10, deadline=None, derandomize=True)
@given(seed=seeds, count=st.integers(0, 9))
def test_any_saved_motion_loads_unchanged(
    tmp_path_factory: pytest.TempPathFactory, seed: int, count: int
) -> None:
    rng = np.random.default_rng(seed)
    poses = np.tile(np.eye(4), (count, 1, 1))
    poses[:, :3, :3] = [Rotation.random(rng=rng).as_matrix() for _ in range(count)] or 0.0
    poses[:, :3, 3] = rng.standard_normal((count, 3))
    motion = Motion(np.cumsum(rng.uniform(0.1, 1.0, count)), {"object": poses})
    path = tmp_path_factory.mktemp("any") / "motion.npz"
    motion.save(path)
    np.testing.assert_array_equal(Motion.load(path).poses["object"], poses)
    np.testing.assert_array_equal(Motion.load(path).times, motion.times)
