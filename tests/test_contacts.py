import csv
import io
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from plyfile import PlyData, PlyElement
from random_directions import random_directions

from lis_grasp.contacts import Contacts
from lis_grasp.exceptions import InvalidContactsError, InvalidFileError

FILES = ["contacts.ply", "contacts.csv"]


def make_contacts(count: int = 7, *, seed: int = 0, full: bool = True) -> Contacts:
    rng = np.random.default_rng(seed)
    normals = random_directions(count, rng)
    points = rng.normal(size=(count, 3)) * 0.05
    if not full:
        return Contacts(points, normals)
    return Contacts(
        points,
        normals,
        rng.uniform(0.1, 2.0, count),
        tuple(rng.choice(["index", "middle", "thumb, left"], count).tolist()),
        np.sort(rng.uniform(0.0, 60.0, count)),
        rng.normal(size=(5, 3)),
        rng.uniform(0.0, 0.02, 5),
        np.where(np.arange(count) == 1, np.nan, rng.uniform(0.0, 0.005, count)),
        rng.uniform(0.0, 0.2, count),
    )


def same(a: Contacts, b: Contacts) -> bool:
    def equal(x: np.ndarray | None, y: np.ndarray | None) -> bool:
        return (x is None and y is None) or (
            x is not None and y is not None and np.array_equal(x, y, equal_nan=True)
        )

    return (
        equal(a.points, b.points)
        and equal(a.normals, b.normals)
        and equal(a.forces, b.forces)
        and equal(a.times, b.times)
        and a.fingers == b.fingers
        and equal(a.free_points, b.free_points)
        and equal(a.free_radii, b.free_radii)
        and equal(a.position_noise, b.position_noise)
        and equal(a.normal_noise, b.normal_noise)
    )


# ---------------------------------------------------------------- the record


def test_contacts_cannot_be_changed() -> None:
    contacts = make_contacts()
    for array in (contacts.points, contacts.normals, contacts.forces, contacts.free_points):
        assert array is not None
        with pytest.raises(ValueError, match="read-only"):
            array[0] = 0.0
    with pytest.raises(AttributeError):
        contacts.points = np.zeros((1, 3))  # type: ignore[misc]


def test_contacts_do_not_follow_the_array_they_were_made_of() -> None:
    points, normals = np.zeros((1, 3)), np.array([[0.0, 0.0, 1.0]])
    contacts = Contacts(points, normals)
    points[0, 0] = normals[0, 0] = 5.0
    assert contacts.points[0, 0] == 0.0
    assert contacts.normals[0, 0] == 0.0


def test_points_in_place_of_normals_are_answered() -> None:
    points = np.array([[0.03, 0.0, 0.0], [0.0, 0.0, 0.04]])
    normals = np.array([[1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])
    for swapped, cure in ((normals, "exchange them"), (2.0 * normals, "divide each")):
        with pytest.raises(InvalidContactsError, match=cure):
            Contacts(swapped, points)


def test_normals_of_few_digits_become_unit_length() -> None:
    contacts = Contacts([[0, 0, 0]], [[0.577, 0.577, 0.577]])
    assert np.linalg.norm(contacts.normals[0]) == pytest.approx(1.0, abs=1e-15)


@pytest.mark.parametrize(
    ("fields", "field", "row"),
    [
        ({"points": [[0, 0]]}, "points", None),
        ({"points": [[0, 0, np.nan]]}, "points", 0),
        ({"points": [["a", 0, 0]]}, "points", None),
        ({"points": [[0, 0, 0], [0, 0]]}, "points", None),
        ({"points": [[0, 1j, 0]]}, "points", None),
        ({"points": [[0, 0, 2e7]]}, "points", 0),
        ({"normals": [[0, 0, 1], [0, 0, 1]]}, "normals", None),
        ({"normals": [[0, 0, 2]]}, "normals", 0),
        ({"normals": [[0, 0, 0]]}, "normals", 0),
        ({"forces": [1.0, 2.0]}, "forces", None),
        ({"forces": [np.inf]}, "forces", 0),
        ({"times": [[0.0]]}, "times", None),
        ({"fingers": ("a", "b")}, "fingers", None),
        ({"fingers": (1,)}, "fingers", None),
        ({"position_noise": [0.1, 0.1]}, "position_noise", None),
        ({"position_noise": [-1e-3]}, "position_noise", 0),
        ({"normal_noise": [np.inf]}, "normal_noise", 0),
        ({"free_points": [[0, 0]]}, "free_points", None),
        ({"free_points": [[0, 0, -2e7]]}, "free_points", 0),
        ({"free_points": [[0, 0, 0]], "free_radii": [-0.1]}, "free_radii", None),
        ({"free_points": [[0, 0, 0]], "free_radii": [2e7]}, "free_radii", None),
        ({"free_points": [[0, 0, 0]], "free_radii": [0.1, 0.1]}, "free_radii", None),
    ],
)
def test_invalid_contacts_are_refused_by_field_and_row(
    fields: dict, field: str, row: int | None
) -> None:
    valid = {"points": [[0, 0, 0]], "normals": [[0, 0, 1]]}
    Contacts(**valid)  # type: ignore[arg-type]
    with pytest.raises(InvalidContactsError) as error:
        Contacts(**(valid | fields))  # type: ignore[arg-type]
    assert (error.value.field, error.value.row) == (field, row)


def test_the_worst_row_is_named() -> None:
    points, normals = np.zeros((3, 3)), np.tile([0.0, 0.0, 1.0], (3, 1))
    points[1, 2], normals[2, 2] = 2e7, 3.0
    with pytest.raises(InvalidContactsError) as error:
        Contacts(points, normals)
    assert (error.value.field, error.value.row) == ("points", 1)
    with pytest.raises(InvalidContactsError) as error:
        Contacts(np.zeros((3, 3)), normals)
    assert (error.value.field, error.value.row) == ("normals", 2)


def test_contacts_are_shown_in_one_line() -> None:
    contacts = Contacts([[0, 0, 0], [0.06, 0, 0]], [[0, 0, 1], [0, 0, 1]], free_points=[[1, 1, 1]])
    assert repr(contacts) == ("Contacts(2 contacts, 1 free points, extent 0.06 m, spacing 0.06 m)")
    assert repr(Contacts.empty()) == "Contacts(0 contacts, extent 0 m, spacing 0 m)"


def test_bounds_and_extent_are_those_of_the_points() -> None:
    contacts = Contacts([[0, 1, 2], [3, -1, 2]], [[0, 0, 1], [0, 0, 1]])
    np.testing.assert_array_equal(contacts.bounds, [[0, -1, 2], [3, 1, 2]])
    assert contacts.extent == 3.0
    assert Contacts.empty().extent == 0.0
    with pytest.raises(InvalidContactsError):
        _ = Contacts.empty().bounds


def test_spacing_is_the_median_distance_to_the_nearest_other_contact() -> None:
    line = np.array([[0, 0, 0], [1, 0, 0], [3, 0, 0], [3, 0, 0]])
    contacts = Contacts(line, np.tile([0.0, 0.0, 1.0], (4, 1)))
    assert contacts.spacing == 1.0  # distances 1, 1, 2: duplicates count once
    assert contacts.subset([0]).spacing == 0.0


@pytest.mark.parametrize(
    "index", [[], [2, 0], [0, 0], slice(1, 3), np.array([True, False, True, False])]
)
def test_a_subset_keeps_rows_together(index: object) -> None:
    contacts = make_contacts(4)
    chosen = np.arange(4)[index]  # type: ignore[index]
    part = contacts.subset(index)  # type: ignore[arg-type]
    for name in ("points", "normals", "forces", "times", "position_noise", "normal_noise"):
        np.testing.assert_array_equal(getattr(part, name), getattr(contacts, name)[chosen])
    assert part.fingers == tuple(contacts.fingers[i] for i in chosen)
    np.testing.assert_array_equal(part.free_points, contacts.free_points)
    np.testing.assert_array_equal(part.free_radii, contacts.free_radii)


def test_appending_joins_rows_and_keeps_only_fields_that_both_have() -> None:
    full, plain = make_contacts(3), make_contacts(2, full=False)
    other = make_contacts(2, seed=1)
    both = full.append(other)
    for name in ("points", "normals", "forces", "times", "free_points", "free_radii"):
        joined = np.concatenate([getattr(full, name), getattr(other, name)])
        np.testing.assert_array_equal(getattr(both, name), joined)
    assert both.fingers == full.fingers + other.fingers
    mixed = full.append(plain)
    assert len(mixed) == 5
    assert mixed.forces is None
    assert mixed.times is None
    assert mixed.fingers == ()
    for before, after in (
        (full.position_noise, mixed.position_noise),
        (full.normal_noise, mixed.normal_noise),
    ):
        assert before is not None
        np.testing.assert_array_equal(after, [*before, np.nan, np.nan])
    assert same(Contacts.empty().append(full), full)
    assert same(full.append(Contacts.empty()), full)
    free = Contacts(np.empty((0, 3)), np.empty((0, 3)), free_points=[[1, 2, 3]], free_radii=[0.1])
    for joined in (free.append(plain), plain.append(free)):
        assert same(joined.subset([]), free)
        np.testing.assert_array_equal(joined.points, plain.points)


def test_noise_that_is_unknown_for_all_has_one_form() -> None:
    plain = make_contacts(3, full=False)
    unknown = Contacts(plain.points, plain.normals, position_noise=[np.nan] * 3)
    assert unknown.position_noise is None
    partly = Contacts(plain.points, plain.normals, position_noise=[0.1, np.nan, np.nan])
    assert partly.subset([1, 2]).position_noise is None


# ---------------------------------------------------------------- files


@pytest.mark.parametrize("name", FILES)
@pytest.mark.parametrize("full", [True, False])
@pytest.mark.parametrize("count", [0, 1, 7])
def test_saved_contacts_load_unchanged(tmp_path: Path, name: str, full: bool, count: int) -> None:
    contacts = make_contacts(count, full=full)
    contacts.save(tmp_path / name)
    loaded = Contacts.load(tmp_path / name)
    if not count:  # forces of no contacts load as None or as no forces
        np.testing.assert_array_equal(loaded.free_points, contacts.free_points)
        assert not len(loaded)
        return
    assert same(loaded, contacts)


@settings(max_examples=30, deadline=None)
@given(
    st.lists(
        st.tuples(*[st.floats(-1.0, 1.0, allow_nan=False)] * 3, st.floats(0, 1e6)),
        min_size=1,
        max_size=5,
    )
)
def test_any_number_loads_unchanged(
    tmp_path_factory: pytest.TempPathFactory, rows: list[tuple[float, ...]]
) -> None:
    table = np.array(rows)
    normals = np.tile([0.0, 0.0, 1.0], (len(rows), 1))
    contacts = Contacts(table[:, :3], normals, table[:, 3])
    folder = tmp_path_factory.mktemp("any")
    for name in FILES:
        contacts.save(folder / name)
        loaded = Contacts.load(folder / name)
        np.testing.assert_array_equal(loaded.points, contacts.points)
        np.testing.assert_array_equal(loaded.forces, contacts.forces)


@pytest.mark.parametrize(
    ("name", "content"),
    [
        ("a.csv", "x,y,z,nx,ny,nz,Position_Noise\n1,2,3,0,0,1,0.002\n1,2,4,0,0,1,\n"),
        ("a.csv", "x,y,z,nx,ny,nz,position_noise\n1,2,3,0,0,1,2e-3\n1,2,4,0,0,1,nan\n"),
        (
            "a.ply",
            "ply\nformat ascii 1.0\nelement vertex 2\n"
            + "".join(f"property double {n}\n" for n in ("x", "y", "z", "nx", "ny", "nz"))
            + "property double scalar_position_noise\nend_header\n"
            "1 2 3 0 0 1 0.002\n1 2 4 0 0 1 nan\n",
        ),
    ],
)
def test_noise_of_another_program_is_read(tmp_path: Path, name: str, content: str) -> None:
    (tmp_path / name).write_text(content)
    contacts = Contacts.load(tmp_path / name)
    np.testing.assert_array_equal(contacts.position_noise, [0.002, np.nan])
    assert contacts.normal_noise is None


@pytest.mark.parametrize("name", FILES)
def test_equal_contacts_make_equal_bytes(tmp_path: Path, name: str) -> None:
    first, second = tmp_path / f"a-{name}", tmp_path / f"b-{name}"
    make_contacts().save(first, header="made by a test")
    make_contacts().save(second, header="made by a test")
    assert first.read_bytes() == second.read_bytes()


def test_header_lines_are_comments_of_a_ply(tmp_path: Path) -> None:
    path = tmp_path / "contacts.ply"
    make_contacts().save(path, header='lis_grasp {"seed": 3}\nsecond line, 5 µm')
    comments = PlyData.read(str(path)).comments
    assert comments[0] == 'lis_grasp {"seed": 3}'
    assert comments[1] == "second line, 5 \\xb5m"
    assert same(Contacts.load(path), make_contacts())


def test_a_ply_is_an_oriented_point_cloud_for_other_programs(tmp_path: Path) -> None:
    path = tmp_path / "contacts.ply"
    contacts = make_contacts()
    contacts.save(path)
    vertex = PlyData.read(str(path))["vertex"]
    names = [p.name for p in vertex.properties]
    assert names[:6] == ["x", "y", "z", "nx", "ny", "nz"]
    np.testing.assert_array_equal(vertex["nz"], contacts.normals[:, 2])


@pytest.mark.parametrize("text", [True, False])
@pytest.mark.parametrize("prefix", ["", "scalar_"])
def test_a_ply_of_another_program_is_read(tmp_path: Path, text: bool, prefix: str) -> None:
    contacts = make_contacts(full=False)
    names = ["nx", "ny", "nz", "red", "z", "y", "x", f"{prefix}force"]
    rows = np.zeros(len(contacts), dtype=[(n, "f4") for n in names])
    for i, axis in enumerate("xyz"):
        rows[axis], rows[f"n{axis}"] = contacts.points[:, i], contacts.normals[:, i]
    rows[f"{prefix}force"] = 0.5
    PlyData([PlyElement.describe(rows, "vertex")], text=text).write(str(tmp_path / "other.ply"))
    loaded = Contacts.load(tmp_path / "other.ply")
    # float32 keeps 24 bits of coordinates below 1 m.
    np.testing.assert_allclose(loaded.points, contacts.points, atol=2.0**-24)
    np.testing.assert_allclose(loaded.normals, contacts.normals, atol=2.0**-22)
    np.testing.assert_array_equal(loaded.forces, 0.5)


def test_fingers_without_names_are_numbered(tmp_path: Path) -> None:
    rows = np.zeros(2, dtype=[(n, "f4") for n in ("x", "y", "z", "nx", "ny", "nz", "finger")])
    rows["nz"], rows["finger"] = 1.0, [0, 3]
    PlyData([PlyElement.describe(rows, "vertex")]).write(str(tmp_path / "other.ply"))
    assert Contacts.load(tmp_path / "other.ply").fingers == ("0", "3")


@pytest.mark.parametrize(
    "text",
    [
        "x,y,z,nx,ny,nz\n1,2,3,0,0,1\n",
        "\ufeffnz, ny, nx, Z, Y, X\r\n1, 0, 0, 3, 2, 1\r\n",
        "x;y;z;nx;ny;nz\n1;2;3;0;0;1\n",
        "# from somewhere\nx,y,z,nx,ny,nz,colour\n\n1,2,3,0,0,1,red\n",
    ],
)
def test_a_csv_of_another_program_is_read(tmp_path: Path, text: str) -> None:
    (tmp_path / "other.csv").write_text(text, encoding="utf-8")
    loaded = Contacts.load(tmp_path / "other.csv")
    np.testing.assert_array_equal(loaded.points, [[1, 2, 3]])
    np.testing.assert_array_equal(loaded.normals, [[0, 0, 1]])


def ply_text(properties: str, row: str, *, comment: str = "none") -> str:
    lines = "".join(f"property float {name}\n" for name in properties.split())
    return f"ply\nformat ascii 1.0\ncomment {comment}\nelement vertex 1\n{lines}end_header\n{row}\n"


@pytest.mark.parametrize(
    ("name", "content", "message"),
    [
        ("a.las", "x", "end in"),
        ("a.ply", "", "PLY"),
        ("a.ply", "solid nonsense", "PLY"),
        ("a.ply", ply_text("x y z nx ny nz", "1 2"), "PLY"),
        (
            "a.ply",
            ply_text("x y z nx ny nz", "1 2 3 0 0 1")
            .replace("float z", "int z", 1)
            .replace("3 0", "9999999999 0"),
            "PLY",
        ),
        (
            "a.ply",
            ply_text("x y z nx ny nz", "1 2 3 0 0 1").replace("vertex 1", "vertex 99999999999999"),
            "PLY",
        ),
        ("a.ply", ply_text("x y z", "1 2 3"), "lacks nx, ny, nz;"),
        ("a.ply", ply_text("x nx ny nz", "1 2 3 4"), "lacks y, z, and has x, nx"),
        (
            "a.ply",
            "ply\nformat ascii 1.0\nelement face 0\nproperty list uchar int i\nend_header\n",
            "vertex",
        ),
        ("a.ply", ply_text("x y z nx ny nz finger", "1 2 3 0 0 1 .5"), "whole numbers"),
        (
            "a.ply",
            ply_text("x y z nx ny nz finger", "1 2 3 0 0 1 2", comment='fingers ["a"]'),
            "1 fingers",
        ),
        (
            "a.ply",
            ply_text("x y z nx ny nz finger", "1 2 3 0 0 1 0", comment="fingers [a"),
            "list of names",
        ),
        ("a.csv", "", "is empty"),
        ("a.csv", "1,2,3,0,0,1\n", "begins with numbers: 1,2,3"),
        ("a.csv", "x,y,z\n1,2,3\n", "lacks nx, ny, nz;"),
        ("a.csv", "x,y,z,nx,ny,nz\n1,2,3\n", "row 1 has 3 cells"),
        ("a.csv", "x,y,z,nx,ny,nz\n1,2,three,0,0,1\n", "row 1 has 'three' for z"),
        ("a.csv", "x,y,z,nx,ny,nz,kind\n1,2,3,0,0,1,odd\n", "the kind 'odd'"),
    ],
)
def test_a_file_without_contacts_is_refused_by_path(
    tmp_path: Path, name: str, content: str, message: str
) -> None:
    path = tmp_path / name
    path.write_text(content)
    with pytest.raises(InvalidFileError, match=message) as caught:
        Contacts.load(path)
    assert caught.value.path == path
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize("write", [ply_text, lambda names, row: f"{names}\n{row}\n"])
def test_invalid_contacts_in_a_file_are_refused_by_path_and_row(
    tmp_path: Path, write: Callable[[str, str], str]
) -> None:
    is_ply = write is ply_text
    names, row = "x y z nx ny nz", "1 2 3 0 0 7"
    if not is_ply:
        names, row = names.replace(" ", ","), row.replace(" ", ",")
    path = tmp_path / ("a.ply" if is_ply else "a.csv")
    path.write_text(write(names, row))
    with pytest.raises(InvalidContactsError) as caught:
        Contacts.load(path)
    assert (caught.value.field, caught.value.row) == ("normals", 0)
    assert str(path) in str(caught.value)


def test_a_missing_folder_is_made_if_possible(tmp_path: Path) -> None:
    make_contacts().save(tmp_path / "new" / "contacts.ply")
    assert len(Contacts.load(tmp_path / "new" / "contacts.ply")) == len(make_contacts())
    (tmp_path / "absent").write_text("a file")
    with pytest.raises(InvalidFileError) as error:
        make_contacts().save(tmp_path / "absent" / "contacts.ply")
    assert error.value.path == tmp_path / "absent" / "contacts.ply"


@pytest.mark.parametrize("name", ["a,b", 'a"b', "a;b", "#a", "a b", "a\u2028b", "a\x0bb", "", "ü"])
@pytest.mark.parametrize("file", FILES)
def test_names_of_fingers_come_back_whatever_they_contain(
    tmp_path: Path, name: str, file: str
) -> None:
    axes = np.eye(3)
    Contacts(axes, axes, fingers=(name, "b", name)).save(tmp_path / file)
    assert Contacts.load(tmp_path / file).fingers == (name, "b", name)


@pytest.mark.parametrize("name", ["a\nb", "a\r", " a", "a\t"])
def test_names_of_fingers_that_a_csv_would_change_are_refused(tmp_path: Path, name: str) -> None:
    contacts = Contacts(np.eye(3), np.eye(3), fingers=(name, name, name))
    with pytest.raises(InvalidFileError):
        contacts.save(tmp_path / "a.csv")
    contacts.save(tmp_path / "a.ply")
    assert Contacts.load(tmp_path / "a.ply").fingers == contacts.fingers


def test_a_binary_file_is_not_a_csv(tmp_path: Path) -> None:
    (tmp_path / "a.csv").write_bytes(b"\xff\xfe\x00rubbish")
    with pytest.raises(InvalidFileError) as error:
        Contacts.load(tmp_path / "a.csv")
    assert error.value.path == tmp_path / "a.csv"


def test_a_saved_csv_is_a_plain_table(tmp_path: Path) -> None:
    make_contacts(3, full=False).save(tmp_path / "a.csv")
    rows = list(csv.DictReader(io.StringIO((tmp_path / "a.csv").read_text())))
    assert list(rows[0]) == ["x", "y", "z", "nx", "ny", "nz"]
    assert len(rows) == 3


def test_free_points_of_files_without_radii_are_points(tmp_path: Path) -> None:
    path = tmp_path / "old.csv"
    path.write_text("x,y,z,nx,ny,nz,kind\n0,0,0,0,0,1,contact\n0,0,1,,,,free\n")
    contacts = Contacts.load(path)
    np.testing.assert_array_equal(contacts.free_points, [[0.0, 0.0, 1.0]])
    np.testing.assert_array_equal(contacts.free_radii, [0.0])
    make_contacts().save(tmp_path / "new.ply")
    text = (tmp_path / "new.ply").read_text().replace("property double radius", "property double r")
    (tmp_path / "old.ply").write_text(text)
    np.testing.assert_array_equal(Contacts.load(tmp_path / "old.ply").free_radii, np.zeros(5))
