"""Contacts from files of points: every format, with and without normals, and fingertip centres."""

from __future__ import annotations

import re
import warnings
from pathlib import Path

import numpy as np
import pytest
import trimesh
from plyfile import PlyData, PlyElement

from lis_grasp import Contacts, shapes
from lis_grasp.cli.main import main
from lis_grasp.exceptions import (
    InvalidContactsError,
    InvalidFileError,
    InvalidOptionError,
    LisGraspWarning,
)
from lis_grasp.geometry import unit
from lis_grasp.io.contact_files import read_point_file
from lis_grasp.surfaces import load_contacts
from lis_grasp.surfaces.contact_checks import fraction_in_front
from lis_grasp.typing import FloatArray

RADIUS = 0.008


@pytest.fixture(scope="module")
def centers() -> FloatArray:
    """Centres of a fingertip that touches a ball of 3 cm at 24 points."""
    points = trimesh.sample.sample_surface(shapes.build("sphere", size=0.06).mesh, 24, seed=0)[0]
    return np.asarray(points) * (0.03 + RADIUS) / np.linalg.norm(points, axis=1, keepdims=True)


def write(path: Path, points: FloatArray) -> Path:
    rows = [" ".join(f"{value:.9f}" for value in point) for point in points]
    if path.suffix == ".off":
        rows = ["OFF", f"{len(points)} 0 0", "", *rows]
    elif path.suffix == ".csv":
        rows = ["x,y,z", *(row.replace(" ", ",") for row in rows)]
    elif path.suffix == ".ply":
        vertices = np.array([tuple(point) for point in points], dtype=[(c, "f8") for c in "xyz"])
        PlyData([PlyElement.describe(vertices, "vertex")], text=True).write(str(path))
        return path
    path.write_text("\n".join(rows) + "\n", encoding="utf-8")
    return path


@pytest.mark.parametrize("radius", [0.2, 8.0])
def test_a_fingertip_larger_than_the_object_is_refused(radius: float, tmp_path: Path) -> None:
    points = trimesh.sample.sample_surface(shapes.build("sphere", size=0.06).mesh, 24, seed=0)[0]
    normals = points / np.linalg.norm(points, axis=1, keepdims=True)
    Contacts(points, normals).save(tmp_path / "contacts.csv")
    with pytest.raises(InvalidOptionError) as error:
        load_contacts(tmp_path / "contacts.csv", fingertip_radius=radius)
    assert (error.value.option, error.value.value) == ("fingertip_radius", radius)


def test_an_unknown_noise_of_some_points_is_as_given_or_as_that_of_the_others(
    centers: FloatArray, tmp_path: Path
) -> None:
    def loaded(noise: list[str], given: float | None = None) -> Contacts:
        points = write(tmp_path / "a.csv", centers).read_text().splitlines()[1:]
        rows = zip(points, noise, strict=True)
        text = "\n".join(["x,y,z,position_noise", *(f"{row},{own}" for row, own in rows)])
        (tmp_path / "a.csv").write_text(text + "\n")
        return load_contacts(tmp_path / "a.csv", position_noise=given)

    all_known, some = loaded(12 * ["0.001", "0.001"]), 12 * ["0.001", ""]
    for found in (loaded(some), loaded(some, 0.001), loaded(24 * [""], 0.001)):
        np.testing.assert_allclose(found.normals, all_known.normals, atol=1e-9)
        np.testing.assert_allclose(found.normal_noise, all_known.normal_noise, atol=1e-9)


@pytest.mark.parametrize(
    "content",
    [
        b"0 0 0 -0.5 1e30 0 2 3\n1 0 0 -0.5 1e30 0 2 3\n2 0 0 -0.5 1e30 0 2 3\n",
        b"# x y z\n0 0 0 \xe9\n\n1\t0\t0 red\n2 0 0\n",
        b"\xef\xbb\xbf0,0,0,red\r\n1, 0, 0, 255\r\n2,0,0\r\n",
    ],
)
def test_rows_of_xyz_begin_with_the_point(content: bytes, tmp_path: Path) -> None:
    path = tmp_path / "a.xyz"
    path.write_bytes(content)
    np.testing.assert_array_equal(
        read_point_file(path)["points"], [[0, 0, 0], [1, 0, 0], [2, 0, 0]]
    )


@pytest.mark.parametrize("ending", ["csv", "ply", "off", "xyz"])
def test_points_of_every_format_become_contacts(
    ending: str, centers: FloatArray, tmp_path: Path
) -> None:
    contacts = load_contacts(write(tmp_path / f"points.{ending}", centers), fingertip_radius=RADIUS)
    radial = centers / np.linalg.norm(centers, axis=1, keepdims=True)
    assert np.all(np.sum(contacts.normals * radial, axis=1) > 0.97)
    assert np.linalg.norm(contacts.points, axis=1) == pytest.approx(0.03, abs=2e-4)
    assert np.all(contacts.normal_noise > 0.0)


def test_normals_in_the_file_are_kept(centers: FloatArray, tmp_path: Path) -> None:
    normals = centers / np.linalg.norm(centers, axis=1, keepdims=True)
    contacts = Contacts(centers, normals, times=np.arange(24.0))
    contacts.save(tmp_path / "contacts.ply")
    assert np.array_equal(load_contacts(tmp_path / "contacts.ply").points, centers)
    moved = load_contacts(tmp_path / "contacts.ply", fingertip_radius=RADIUS)
    assert np.linalg.norm(moved.points, axis=1) == pytest.approx(0.03)
    assert np.array_equal(moved.normals, contacts.normals)
    assert moved.normal_noise is None


def test_other_columns_are_kept(tmp_path: Path) -> None:
    path = tmp_path / "points.csv"
    path.write_text(
        "x,y,z,ax,ay,az,force,time,finger,kind,radius\n"
        "0,0,0,0,0,-1,2,5,index,contact,\n0,0.01,0,0,0,-1,3,6,thumb,contact,\n"
        "0,0,0.05,,,,,,,free,0.01\n"
    )
    contacts = load_contacts(path)
    assert contacts.normals[:, 2] == pytest.approx(1.0, abs=0.03)
    assert contacts.fingers == ("index", "thumb")
    assert contacts.forces == pytest.approx([2.0, 3.0])
    assert contacts.times == pytest.approx([5.0, 6.0])
    assert contacts.free_radii == pytest.approx([0.01])


def test_the_command_estimates_a_surface_from_fingertip_centres(
    centers: FloatArray, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = write(tmp_path / "points.csv", centers)
    options = ["--fingertip-radius", str(RADIUS), "--estimator", "gpis"]
    assert main(["estimate", str(path), *options]) == 0
    kept = Contacts.load(tmp_path / "contacts.ply")
    degrees = np.rad2deg(np.median(kept.normal_noise))
    assert f"normals: estimated, with a median standard deviation of {degrees:.0f} deg" in (
        capsys.readouterr().out
    )
    mesh = trimesh.load(tmp_path / "surface.ply")
    assert mesh.is_watertight
    assert np.linalg.norm(mesh.vertices, axis=1) == pytest.approx(0.03, abs=2e-3)


@pytest.mark.slow
def test_a_cloud_and_fingertip_centres_are_joined(centers: FloatArray, tmp_path: Path) -> None:
    touches = write(tmp_path / "touches.csv", centers)
    mesh = shapes.build("sphere", size=0.06).mesh
    cloud = write(tmp_path / "cloud.xyz", trimesh.sample.sample_surface(mesh, 400, seed=1)[0])
    radii = ["--fingertip-radius", "0", "--fingertip-radius", str(RADIUS)]
    assert main(["estimate", str(cloud), str(touches), *radii, "--estimator", "gpis"]) == 0
    mesh = trimesh.load(tmp_path / "surface.ply")
    assert np.linalg.norm(mesh.vertices, axis=1) == pytest.approx(0.03, abs=2e-3)
    assert main(["estimate", str(cloud), str(touches), *radii[:2]]) == 2


@pytest.mark.parametrize(
    ("name", "content", "said"),
    [
        ("a.csv", "x,y,z\n1,2,3\n1,2,4\n", "a.csv: normals need at least 4 points"),
        ("a.csv", "x,y,z,nx\n1,2,3,0\n", "lacks ny, nz"),
        ("a.csv", "x,y,z,ax,ay\n1,2,3,0,1\n", "lacks az"),
        ("a.off", "OFF\n0 0 0\n", "a.off "),
        ("a.off", "no points", "a.off "),
        ("a.xyz", "1 2\n", "row 1 has 2 of the 3 numbers"),
        ("a.xyz", "0.1,,0.3,255\n", "has no points: all 1 rows are nan or blank"),
        ("a.xyz", "0,5 1,0 2,0\n", "decimal comma"),
        ("a.xyz", "0,5;1,0;2,0\n", "decimal comma"),
        ("a.xyz", "x;y;colour\n1;2;3\n", "has 'x' for x, where a number"),
        ("a.pts", "3\n0 0 0\n", "announces 3 points, and has 1"),
        ("a.npy", "", "a.npy must be NPY; it is empty"),
        ("a.xyz", "# nothing\n", "a.xyz must be XYZ; it is empty"),
        ("a.pcd", "VERSION .7\n", "has no line DATA"),
        ("a.las", "LASF", ".ply, .csv, .pcd"),
        ("a.csv", "<html><body>x</body></html>", "it is a web page"),
        ("a.ply", "version https://git-lfs.github.com/spec/v1\n", "git lfs pull"),
        ("a.csv", "a,b\n1,2\n", "must have columns x,y,z, .*; it has a, b$"),
        ("a.pcd", "FIELDS x y z\nSIZE 4 4\nTYPE F F F\nPOINTS 1\nDATA ascii\n", "not equally many"),
        ("a.npy", "hello", "no NPY"),
        ("a.stl", "solid", "lis-grasp grasp .*a.stl"),
        ("a.csv", "x,y,z,nx,ny,nz\n0,0,0,0,0,2\n", "by its length"),
    ],
)
def test_what_is_missing_is_said(name: str, content: str, said: str, tmp_path: Path) -> None:
    (tmp_path / name).write_text(content)
    with pytest.raises((InvalidFileError, InvalidContactsError), match=said):
        load_contacts(tmp_path / name)
    assert main(["estimate", str(tmp_path / name)]) == 2


def test_lengths_of_every_unit_are_read(centers: FloatArray, tmp_path: Path) -> None:
    normals = centers / np.linalg.norm(centers, axis=1, keepdims=True)
    free = {"free_points": 2.0 * centers, "free_radii": np.full(24, 0.01)}
    noise = {"position_noise": np.full(24, 0.001), "normal_noise": np.full(24, 0.1)}
    exact = Contacts(centers, normals, **free, **noise)
    for units, metres in shapes.UNITS.items():
        scaled = {name: values / metres for name, values in free.items()}
        scaled["position_noise"] = noise["position_noise"] / metres
        file = tmp_path / f"{units}.ply"
        Contacts(centers / metres, normals, normal_noise=noise["normal_noise"], **scaled).save(file)
        read = load_contacts(file, units=units)
        for name in ("points", "free_points", "free_radii", "position_noise", "normal_noise"):
            assert getattr(read, name) == pytest.approx(getattr(exact, name), rel=1e-12), name


def test_contacts_in_a_mistaken_unit_are_refused(centers: FloatArray, tmp_path: Path) -> None:
    path = write(tmp_path / "points.csv", 1e3 * centers)
    with pytest.raises(InvalidContactsError, match="`units` mm "):
        load_contacts(path)
    path = write(tmp_path / "points.csv", centers)
    with pytest.raises(InvalidContactsError, match="`units` m "):
        load_contacts(path, units="mm")


@pytest.mark.parametrize("name", shapes.NAMES)
def test_inward_normals_are_refused_and_flipped_on_request(name: str, tmp_path: Path) -> None:
    mesh = shapes.build(name).mesh
    points, faces = trimesh.sample.sample_surface(mesh, 40, seed=0)
    outward, path = Contacts(points, mesh.face_normals[faces]), tmp_path / "contacts.ply"
    outward.save(path)
    assert np.array_equal(load_contacts(path).normals, outward.normals)
    inward = Contacts(points, -outward.normals)
    inward.save(path)
    assert np.array_equal(load_contacts(path, normals="inward").normals, outward.normals)
    assert np.array_equal(load_contacts(path, normals="outward").normals, inward.normals)
    # A pair with a height has another sign for inward normals: both fractions add up to 1.
    assert fraction_in_front(outward) + fraction_in_front(inward) == pytest.approx(1.0)
    if name not in ("torus", "hollow_cylinder"):  # contacts in a hole leave doubt
        with pytest.raises(InvalidContactsError) as error:
            load_contacts(path)
        assert error.value.field == "normals"


def test_estimate_prints_the_size(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    axes = np.vstack([np.eye(3), -np.eye(3)])
    path = tmp_path / "contacts.csv"
    Contacts(30.0 * axes, axes).save(path)
    assert main(["estimate", str(path), "--units", "mm"]) == 0
    said, noted = capsys.readouterr()
    assert "contacts: 6 within 60 x 60 x 60 mm" in said
    assert "estimate: 60" in said
    assert "note: fewer than 10 contacts" in noted
    assert "normals:" not in said
    assert main(["estimate", str(path)]) == 2
    assert "--units mm" in capsys.readouterr().err


@pytest.mark.slow
def test_estimate_prints_how_much_of_the_surface_no_contact_is_near(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    directions = trimesh.creation.icosphere(subdivisions=2).vertices
    upper = directions[directions[:, 2] >= 0.0]
    Contacts(0.03 * upper, upper).save(tmp_path / "ball.csv")
    arguments = ["estimate", str(tmp_path / "ball.csv"), "--estimator", "gpis"]
    assert main(arguments) == 0
    said = capsys.readouterr().out
    matched = re.search(r"untouched: (\d+) % of the surface is more than ([\d.]+) mm", said)
    assert matched is not None
    percent, near = map(float, matched.groups())
    mesh = trimesh.load(tmp_path / "surface.ply")
    points, _ = trimesh.sample.sample_surface(mesh, 4000, seed=0)
    distances = np.linalg.norm(points[:, None] - 0.03 * upper, axis=2).min(axis=1)
    assert percent == pytest.approx(100.0 * np.mean(1e3 * distances > near), abs=3.0)  # 4 sigma
    assert 10.0 < percent < 50.0


# ---------------------------------------------------------------- files as programs write them

# Two points each on the faces of a cube of 6 cm, with the normals of the faces.
_NORMALS = np.repeat(np.vstack([np.eye(3), -np.eye(3)]), 2, axis=0)
_SIDE = 0.01 * np.roll(_NORMALS, 1, axis=1) * np.tile([[1.0], [-1.0]], (6, 1))
_ROWS = np.hstack([0.03 * _NORMALS + _SIDE, _NORMALS])


def _text(header: str, rows: FloatArray = _ROWS, separator: str = ",") -> str:
    lines = [separator.join(f"{value:.9g}" for value in row) for row in rows]
    return "\n".join([header, *lines]) + "\n"


@pytest.mark.parametrize(
    ("header", "separator"),
    [
        ("x,y,z,normal_x,normal_y,normal_z", ","),  # PCL
        ("x,y,z,n_x,n_y,n_z", ","),
        ("//X,Y,Z,Nx,Ny,Nz", ","),  # CloudCompare
        ("x,y,z,scalar_nx,scalar_ny,scalar_nz", ","),
        ("# x,y,z,nx,ny,nz", " "),  # numpy.savetxt with its default delimiter
        ("# x y z nx ny nz", " "),
        ("x\ty\tz\tnx\tny\tnz", "\t"),
        ("x;y;z;nx;ny;nz", ";"),
        ('"Points:0","Points:1","Points:2","Normals:0","Normals:1","Normals:2"', ","),  # ParaView
        ("pose.position.x,pose.position.y,pose.position.z,normal.x,normal.y,normal.z", ","),
        ("# gemessen von M\xfcller\nx,y,z,nx,ny,nz", ","),  # Latin-1
    ],
)
def test_normals_are_read_under_the_names_of_other_programs(
    header: str, separator: str, tmp_path: Path
) -> None:
    path = tmp_path / "a.csv"
    path.write_bytes(_text(header, separator=separator).encode("latin-1"))
    contacts = load_contacts(path)
    np.testing.assert_allclose(contacts.points, _ROWS[:, :3])
    np.testing.assert_array_equal(contacts.normals, _NORMALS)
    assert contacts.normal_noise is None  # measured, not estimated


def test_properties_of_a_ply_have_the_names_of_other_programs(tmp_path: Path) -> None:
    names = ["x", "y", "z", "normal_x", "normal_y", "normal_z", "curvature"]
    rows = np.zeros(len(_ROWS), dtype=[(name, "f4") for name in names])
    for name, column in zip(names, _ROWS.T, strict=False):
        rows[name] = column
    PlyData([PlyElement.describe(rows, "vertex")]).write(str(tmp_path / "a.ply"))
    with pytest.warns(LisGraspWarning, match="not used: curvature$"):
        contacts = load_contacts(tmp_path / "a.ply")
    np.testing.assert_array_equal(contacts.normals, _NORMALS)


def test_units_in_the_names_of_columns_are_used_and_must_not_be_contradicted(
    tmp_path: Path,
) -> None:
    path = tmp_path / "a.csv"
    path.write_text(_text("x [mm],y [mm],z [mm],nx,ny,nz", _ROWS * [[1e3] * 3 + [1] * 3]))
    for units in (None, "mm"):
        with pytest.warns(LisGraspWarning, match="in mm"):
            np.testing.assert_allclose(load_contacts(path, units=units).points, _ROWS[:, :3])
    with pytest.raises(InvalidOptionError) as error:
        load_contacts(path, units="m")
    assert error.value.option == "units"


@pytest.mark.parametrize(
    ("empty", "said"),
    [
        (["nan"] * 6, "left out rows 3, 8 of 12, without a point"),
        ([""] * 6, "left out rows 3, 8 of 12, without a point"),
        (["0.01", "", "0.02", "0", "0", "1"], "left out rows 3, 8 of 12, without a point"),
        (["0"] * 6, "3, 8 of 12, with a point and no normal"),
        (
            ["0.01", "0.01", "0.03", "nan", "nan", "nan"],
            "3, 8 of 12, with a point and no normal",
        ),
    ],
)
def test_rows_without_a_contact_are_left_out_and_counted(
    empty: list[str], said: str, tmp_path: Path
) -> None:
    lines = _text("x,y,z,nx,ny,nz").splitlines()
    for row in (2, 7):
        lines[1 + row] = ",".join(empty)
    (tmp_path / "a.csv").write_text("\n".join(lines))
    with pytest.warns(LisGraspWarning, match=said):
        contacts = load_contacts(tmp_path / "a.csv")
    np.testing.assert_allclose(contacts.points, np.delete(_ROWS, [2, 7], axis=0)[:, :3])


@pytest.mark.parametrize("border", [0.0, pytest.param(0.02, marks=pytest.mark.slow), 0.06])
@pytest.mark.parametrize("normals", ["none", "up", "down"])
def test_a_table_round_the_object_is_noted_and_a_foot_of_it_is_not(
    border: float, normals: str, tmp_path: Path, recwarn: pytest.WarningsRecorder
) -> None:
    # A ball of 30 mm radius, and points below it; normals down are those of its own foot.
    rng = np.random.default_rng(0)
    ball = unit(rng.normal(size=(300, 3)))
    reach = 0.03 + border
    base = np.column_stack([rng.uniform(-reach, reach, (150, 2)), np.full(150, -0.03)])
    base = base if border else base[:0]
    sides = np.tile([0.0, 0.0, -1.0 if normals == "down" else 1.0], (len(base), 1))
    rows = np.hstack([np.vstack([0.03 * ball, base]), np.vstack([ball, sides])])
    header = "x,y,z" if normals == "none" else "x,y,z,nx,ny,nz"
    (tmp_path / "a.csv").write_text(_text(header, rows[:, : len(header.split(","))]))
    assert len(load_contacts(tmp_path / "a.csv")) == len(rows)
    said = [str(warning.message) for warning in recwarn]
    assert len(said) == (border > 0.0 and normals != "down")
    # A third of the points, and those of the ball that are as near to the plane.
    assert all(re.search("3[3-9] % of the points are in a plane", text) for text in said)


@pytest.mark.parametrize("place", [(0.13, -0.1, 0.63), (-0.15, -0.44, -0.51)])
def test_empty_rows_are_no_table(
    place: tuple[float, ...], tmp_path: Path, recwarn: pytest.WarningsRecorder
) -> None:
    ball = unit(np.random.default_rng(0).normal(size=(40, 3)))
    rows = np.vstack([0.03 * ball + place, np.zeros((50, 3))])
    (tmp_path / "a.csv").write_text(_text("x,y,z", rows))
    assert len(load_contacts(tmp_path / "a.csv")) == len(rows)
    assert not recwarn.list


@pytest.mark.parametrize("mark", [";", " ", ","])
def test_points_in_rows_may_be_separated_by_any_mark_and_radii_without_a_kind_are_noted(
    mark: str, tmp_path: Path
) -> None:
    head = mark.join([*"xyz", "nx", "ny", "nz", "radius"])
    radii = np.full((len(_ROWS), 1), 0.02)
    (tmp_path / "a.xyz").write_text(_text("", _ROWS, mark))
    (tmp_path / "a.csv").write_text(_text(head, np.hstack([_ROWS, radii]), mark))
    np.testing.assert_allclose(load_contacts(tmp_path / "a.xyz").points, _ROWS[:, :3])
    with pytest.warns(LisGraspWarning, match="radius is not used"):
        load_contacts(tmp_path / "a.csv")


def test_the_command_prints_what_was_left_out(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / "a.csv"
    path.write_text(_text("x,y,z,nx,ny,nz").replace("\n", ",\n").replace("nz,", "nz,force", 1))
    assert main(["estimate", str(path), "--estimator", "gpis"]) == 0
    assert capsys.readouterr().err.count("note: ") == 1


@pytest.mark.parametrize(
    ("content", "said"),
    [
        (b"x;y;z\n0,1;0,2;0,3\n", "decimal comma"),
        (b"x,y,z\n0,1,0,2,0,3\n", "decimal point, not a comma"),
        (b"x,y,z\n0,1;0,2;0,3\n", "decimal point, not a comma"),
        (b"x y z\n0,1 0,2 0,3\n", "decimal point, not a comma"),
        (b"time,x,y,z\n2026-11-26T03:00,1,2,3\n", "a date or a time of day.: write seconds"),
        (_text("").encode().strip(), "begins with numbers"),
        ("x,y,z\n1,2,3\n".encode("utf-16"), "UTF-16"),
        ("x,y,z,finger\n1,2,3,M\xfc\n".encode("latin-1"), "not UTF-8"),
        (b"x,y,z,pos_x\n1,2,3,4\n", "two columns for x: x and pos_x"),
        (b"x [mm],y [cm],z\n1,2,3\n", "in cm and mm"),
        (b"x [km],y [km],z\n1,2,3\n", "km"),
        (b"x,y,z\nnan,nan,nan\n", "all 1 rows"),
    ],
)
def test_tables_of_other_kinds_are_refused_by_their_kind(
    content: bytes, said: str, tmp_path: Path
) -> None:
    (tmp_path / "a.csv").write_bytes(content)
    with pytest.raises(InvalidFileError, match=said):
        load_contacts(tmp_path / "a.csv")


def _pcd(rows: FloatArray, kind: str) -> bytes:
    """Return a PCD with normals and curvature as PCL writes it."""
    fields = "x y z normal_x normal_y normal_z curvature"
    head = (
        f"# .PCD v0.7\nVERSION 0.7\nFIELDS {fields}\nSIZE{' 4' * 7}\nTYPE{' F' * 7}\n"
        f"COUNT{' 1' * 7}\nWIDTH {len(rows)}\nHEIGHT 1\nVIEWPOINT 0 0 0 1 0 0 0\n"
        f"POINTS {len(rows)}\nDATA {kind}\n"
    ).encode()
    table = np.column_stack([rows, np.zeros(len(rows))]).astype("<f4")
    if kind == "ascii":
        return head + "".join(" ".join(map(str, row)) + "\n" for row in table).encode()
    if kind == "binary":
        return head + table.tobytes()
    data = table.T.tobytes()
    literal = 24 * len(rows)  # the curvature after it is a zero, and a reference that repeats it
    packed = b"".join(b"\x1f" + data[k : k + 32] for k in range(0, literal, 32))
    packed += b"\x00\x00" + bytes([7 << 5, len(data) - literal - 10, 0])
    return head + np.array([len(packed), len(data)], "<u4").tobytes() + packed


@pytest.mark.parametrize("kind", ["ascii", "binary", "binary_compressed"])
def test_point_clouds_of_pcl_are_read_with_their_normals(kind: str, tmp_path: Path) -> None:
    rows = np.vstack([_ROWS, _ROWS + [[0, 0, 0.02, 0, 0, 0]]])
    (tmp_path / "a.pcd").write_bytes(_pcd(rows, kind))
    contacts = load_contacts(tmp_path / "a.pcd", normals="outward")
    np.testing.assert_allclose(contacts.points, rows[:, :3], atol=1e-8)
    np.testing.assert_array_equal(contacts.normals, rows[:, 3:])
    np.testing.assert_array_equal(Contacts.load(tmp_path / "a.pcd").points, contacts.points)
    (tmp_path / "a.pcd").write_bytes(_pcd(rows, kind).replace(b"POINTS 24", b"POINTS 25"))
    with pytest.raises(InvalidFileError) as error:
        load_contacts(tmp_path / "a.pcd")
    assert error.value.path == tmp_path / "a.pcd"


def test_arrays_of_numpy_are_points_with_normals(tmp_path: Path) -> None:
    named = np.zeros(len(_ROWS), dtype=[(name, "f4") for name in ("x", "y", "z", "nx", "ny", "nz")])
    for name, column in zip(named.dtype.names, _ROWS.T, strict=True):
        named[name] = column
    np.save(tmp_path / "plain.npy", _ROWS)
    np.save(tmp_path / "image.npy", _ROWS.reshape(3, 4, 6))
    np.save(tmp_path / "named.npy", named)
    np.savez(tmp_path / "two.npz", points=_ROWS[:, :3], normals=_ROWS[:, 3:], label=["a"])
    np.savez_compressed(tmp_path / "one.npz", _ROWS)
    for name in ("plain.npy", "image.npy", "named.npy", "two.npz", "one.npz"):
        contacts = load_contacts(tmp_path / name)
        np.testing.assert_allclose(contacts.points, _ROWS[:, :3], atol=1e-8)
        np.testing.assert_array_equal(contacts.normals, _NORMALS)
    with pytest.warns(LisGraspWarning, match="not used: label"):
        load_contacts(tmp_path / "two.npz")
    for array in (_ROWS.T, np.array([{}]), np.array(["a", "b", "c"])):
        np.save(tmp_path / "a.npy", array, allow_pickle=True)
        with pytest.raises(InvalidFileError) as error:
            load_contacts(tmp_path / "a.npy")
        assert error.value.path == tmp_path / "a.npy"
    np.savez(tmp_path / "a.npz", points=_ROWS[:, :3], normals=_ROWS[:5, 3:])
    with pytest.raises(InvalidFileError) as error:
        load_contacts(tmp_path / "a.npz")
    assert error.value.path == tmp_path / "a.npz"


@pytest.mark.parametrize("name", ["a.xyz", "a.xyzn", "a.pts", "a.txt", "a.off"])
def test_columns_without_names_are_normals_if_their_lengths_are_1(
    name: str, tmp_path: Path
) -> None:
    head = {".pts": ["12"], ".off": ["NOFF", "12 0 0"]}.get(name[1:], [])

    def write(rows: FloatArray) -> None:
        lines = [" ".join(f"{value:.9g}" for value in row) for row in rows]
        (tmp_path / name).write_text("\n".join([*head, *lines]) + "\n")

    write(_ROWS)
    with pytest.warns(LisGraspWarning, match="columns 4 to 6 have length 1"):
        contacts = load_contacts(tmp_path / name)
    np.testing.assert_array_equal(contacts.normals, _NORMALS)
    assert contacts.normal_noise is None
    write(_ROWS * [[1, 1, 1, 255, 128, 0]])  # colours
    with pytest.warns(LisGraspWarning, match="from the fourth on are not used"):
        assert load_contacts(tmp_path / name).normal_noise is not None
    write(_ROWS[:, :3])
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        assert len(load_contacts(tmp_path / name)) == 12
