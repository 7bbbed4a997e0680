"""The built-in objects against closed forms: their distance functions, volumes and edge lengths."""

from collections.abc import Callable
from pathlib import Path

import numpy as np
import numpy.testing as npt
import pytest
import trimesh
from scipy.spatial import ConvexHull

from lis_grasp import shapes
from lis_grasp.exceptions import InvalidFileError, InvalidMeshError, InvalidOptionError
from lis_grasp.shapes import Shape
from lis_grasp.typing import FloatArray

# A chord of the mesh leaves the true surface by at most this at 20 cm; see shapes.builtin.
CHORD = 1e-4
# Coordinates are sums and products of a few numbers near 0.1.
ROUNDING = 1e-15


# ------------------------------------------- exact distances at size 1, negative inside


def extruded(plane: FloatArray, z: FloatArray, half: float) -> FloatArray:
    """Distance to an upright prism from the distance to its outline in the plane."""
    rise = np.abs(z) - half
    outside = np.hypot(np.maximum(plane, 0.0), np.maximum(rise, 0.0))
    return outside + np.minimum(np.maximum(plane, rise), 0.0)


def rectangle(x: FloatArray, y: FloatArray, a: float, b: float) -> FloatArray:
    dx, dy = np.abs(x) - a, np.abs(y) - b
    outside = np.hypot(np.maximum(dx, 0.0), np.maximum(dy, 0.0))
    return outside + np.minimum(np.maximum(dx, dy), 0.0)


def convex_polygon(x: FloatArray, y: FloatArray, corners: FloatArray) -> FloatArray:
    points = np.stack([x, y], axis=-1)
    sides, planes = [], []
    for a, b in zip(corners, np.roll(corners, -1, axis=0), strict=True):
        along = b - a
        fraction = np.clip((points - a) @ along / (along @ along), 0.0, 1.0)
        sides.append(np.linalg.norm(points - a - fraction[..., None] * along, axis=-1))
        outward = np.array([along[1], -along[0]]) / np.linalg.norm(along)
        planes.append((points - a) @ outward)
    inside = np.max(planes, axis=0) < 0.0
    return np.where(inside, -1.0, 1.0) * np.min(sides, axis=0)


def box(p: FloatArray) -> FloatArray:
    return extruded(rectangle(p[..., 0], p[..., 1], 0.35, 0.25), p[..., 2], 0.5)


def cylinder(p: FloatArray) -> FloatArray:
    return extruded(np.hypot(p[..., 0], p[..., 1]) - 0.3, p[..., 2], 0.5)


def half_cylinder(p: FloatArray) -> FloatArray:
    x, y = p[..., 0], p[..., 1] + 0.2
    disc = np.hypot(x, y) - 0.4
    flat = np.hypot(np.maximum(np.abs(x) - 0.4, 0.0), y)  # to the flat side's segment
    plane = np.where(y < 0.0, flat, np.where(disc < 0.0, np.maximum(disc, -y), disc))
    return extruded(plane, p[..., 2], 0.5)


def hollow_cylinder(p: FloatArray) -> FloatArray:
    radius = np.hypot(p[..., 0], p[..., 1])
    return rectangle(radius - 0.2875, p[..., 2], 0.0625, 0.5)


def sphere(p: FloatArray) -> FloatArray:
    return np.linalg.norm(p, axis=-1) - 0.5


def torus(p: FloatArray) -> FloatArray:
    return np.hypot(np.hypot(p[..., 0], p[..., 1]) - 1.0 / 3.0, p[..., 2]) - 1.0 / 6.0


def pentagon(p: FloatArray) -> FloatArray:
    angles = np.pi / 2.0 + 2.0 * np.pi * np.arange(5) / 5.0
    corners = 0.375 * np.column_stack([np.cos(angles), np.sin(angles)])
    corners[:, 1] -= 0.5 * (corners[:, 1].max() + corners[:, 1].min())
    return extruded(convex_polygon(p[..., 0], p[..., 1], corners), p[..., 2], 0.5)


def mallet(p: FloatArray) -> FloatArray:
    """Exact outside; inside only its sign and zero set, as the nearer of two solids is."""
    x, y, z = p[..., 0], p[..., 1], p[..., 2]
    head = extruded(rectangle(x, y, 0.35, 0.2), z + 0.3, 0.2)
    # The handle reaches into the head, so that the disc where they meet is no surface.
    handle = extruded(np.hypot(x, y) - 0.14, z - 0.1, 0.4)
    return np.minimum(head, handle)


DISTANCES: dict[str, Callable[[FloatArray], FloatArray]] = {
    "box": box,
    "cylinder": cylinder,
    "half_cylinder": half_cylinder,
    "hollow_cylinder": hollow_cylinder,
    "sphere": sphere,
    "torus": torus,
    "pentagon": pentagon,
    "mallet": mallet,
}

PENTAGON_AREA = 2.5 * 0.375**2 * np.sin(2.0 * np.pi / 5.0)
# Volume [1 = size^3] and total length of the sharp edges [1 = size], all by hand.
VOLUMES = {
    "box": 0.7 * 0.5,
    "cylinder": np.pi * 0.3**2,
    "half_cylinder": np.pi * 0.4**2 / 2.0,
    "hollow_cylinder": np.pi * (0.35**2 - 0.225**2),
    "sphere": np.pi / 6.0,
    "torus": 2.0 * np.pi**2 / 3.0 / 36.0,
    "pentagon": PENTAGON_AREA,
    "mallet": 0.7 * 0.4 * 0.4 + np.pi * 0.14**2 * 0.6,
}
EDGE_LENGTHS = {
    "box": 4.0 * (0.7 + 0.5 + 1.0),
    "cylinder": 2.0 * 2.0 * np.pi * 0.3,
    "half_cylinder": 2.0 * (np.pi * 0.4 + 0.8) + 2.0,
    "hollow_cylinder": 4.0 * np.pi * (0.35 + 0.225),
    "sphere": 0.0,
    "torus": 0.0,
    "pentagon": 2.0 * 5.0 * 2.0 * 0.375 * np.sin(np.pi / 5.0) + 5.0,
    "mallet": 4.0 * (0.7 + 0.4 + 0.4) + 2.0 * 2.0 * np.pi * 0.14,
}


@pytest.fixture(scope="module")
def paper_set() -> dict[str, Shape]:
    return {name: shapes.build(name, shapes.PAPER_SIZE) for name in shapes.NAMES}


@pytest.mark.parametrize("name", shapes.NAMES)
def test_mesh_vertices_lie_on_the_exact_surface(name: str, paper_set: dict[str, Shape]) -> None:
    vertices = np.asarray(paper_set[name].mesh.vertices) / shapes.PAPER_SIZE
    assert np.abs(DISTANCES[name](vertices)).max() < 4.0 * ROUNDING


@pytest.mark.parametrize("name", shapes.NAMES)
def test_no_chord_leaves_the_exact_surface_by_a_tenth_of_a_millimetre(
    name: str, paper_set: dict[str, Shape]
) -> None:
    triangles = np.asarray(paper_set[name].mesh.triangles)  # (F, 3, 3)
    corners = np.eye(3)
    weights = np.vstack([np.full(3, 1.0 / 3.0), (corners + np.roll(corners, 1, axis=0)) / 2.0])
    points = np.einsum("wk,fkd->fwd", weights, triangles)  # middles of faces and of edges
    errors = shapes.PAPER_SIZE * DISTANCES[name](points / shapes.PAPER_SIZE)
    assert np.abs(errors).max() < CHORD


@pytest.mark.parametrize("name", shapes.NAMES)
def test_faces_look_outward(name: str, paper_set: dict[str, Shape]) -> None:
    mesh = paper_set[name].mesh
    outside = mesh.triangles_center + 1e-3 * mesh.face_normals
    inside = mesh.triangles_center - 1e-3 * mesh.face_normals
    assert DISTANCES[name](outside / shapes.PAPER_SIZE).min() > 0.0
    assert DISTANCES[name](inside / shapes.PAPER_SIZE).max() < 0.0


@pytest.mark.parametrize("name", shapes.NAMES)
def test_volume_is_that_of_the_formula(name: str, paper_set: dict[str, Shape]) -> None:
    mesh, size = paper_set[name].mesh, shapes.PAPER_SIZE
    # Chords may take away their error over the whole area; flat faces take away nothing.
    assert mesh.volume == pytest.approx(VOLUMES[name] * size**3, abs=CHORD * mesh.area)


@pytest.mark.parametrize("name", shapes.NAMES)
def test_sharp_edges_have_the_length_of_the_formula(name: str, paper_set: dict[str, Shape]) -> None:
    edges = paper_set[name].edges
    length = np.linalg.norm(edges[:, 1] - edges[:, 0], axis=1).sum()
    # A circle of 64 chords or more is shorter than it should be by pi^2 / 6 / 64^2 of its length.
    assert length == pytest.approx(EDGE_LENGTHS[name] * shapes.PAPER_SIZE, rel=5e-4)


@pytest.mark.parametrize("name", shapes.NAMES)
def test_edges_form_closed_lines_on_the_surface(name: str, paper_set: dict[str, Shape]) -> None:
    edges = paper_set[name].edges
    assert np.abs(DISTANCES[name](edges / shapes.PAPER_SIZE)).max(initial=0.0) < 4.0 * ROUNDING
    # Without loose ends, every end is shared by at least two pieces.
    _, counts = np.unique(np.round(edges.reshape(-1, 3), 9), axis=0, return_counts=True)
    assert counts.min(initial=2) >= 2


def test_the_mallet_has_one_concave_edge(paper_set: dict[str, Shape]) -> None:
    mesh = paper_set["mallet"].mesh
    concave = (mesh.face_adjacency_angles > shapes.SHARP_ANGLE) & ~mesh.face_adjacency_convex
    ends = mesh.vertices[mesh.face_adjacency_edges[concave]].reshape(-1, 3)
    np.testing.assert_allclose(np.hypot(ends[:, 0], ends[:, 1]), 0.14 * 0.2, atol=1e-12)
    np.testing.assert_allclose(ends[:, 2], -0.1 * 0.2, atol=1e-12)


@pytest.mark.parametrize("name", shapes.NAMES)
def test_meshes_are_closed_light_and_without_slivers(
    name: str, paper_set: dict[str, Shape]
) -> None:
    mesh = paper_set[name].mesh
    assert mesh.is_watertight
    assert mesh.is_winding_consistent
    assert len(mesh.faces) <= 20_000
    assert mesh.euler_number == (0 if name in ("hollow_cylinder", "torus") else 2)
    assert np.degrees(trimesh.triangles.angles(mesh.triangles).min()) > 9.0
    assert mesh.body_count == 1


@pytest.mark.parametrize("name", shapes.NAMES)
@pytest.mark.parametrize("size", [None, 0.2, 0.05])
def test_the_largest_extent_is_the_size_about_the_origin(name: str, size: float | None) -> None:
    shape = shapes.build(name, size)
    wanted = shapes.GRASPABLE_SIZES[name] if size is None else size
    assert shape.size == pytest.approx(wanted, abs=1e-15)
    np.testing.assert_allclose(shape.mesh.bounds.sum(axis=0), 0.0, atol=1e-15)
    assert shape.name == name
    assert shape.repairs == ()


@pytest.mark.parametrize("name", shapes.NAMES)
def test_every_size_is_the_same_shape(name: str, paper_set: dict[str, Shape]) -> None:
    small = shapes.build(name, 0.05)
    np.testing.assert_array_equal(small.mesh.faces, paper_set[name].mesh.faces)
    np.testing.assert_allclose(4.0 * small.mesh.vertices, paper_set[name].mesh.vertices, atol=1e-15)
    np.testing.assert_allclose(4.0 * small.edges, paper_set[name].edges, atol=1e-15)


@pytest.mark.parametrize("name", [n for n in shapes.NAMES if n != "sphere"])
def test_objects_stand_where_they_are_put(name: str, paper_set: dict[str, Shape]) -> None:
    mesh = paper_set[name].mesh
    on_table = mesh.vertices[mesh.vertices[:, 2] < mesh.bounds[0, 2] + 1e-12]
    sides = ConvexHull(on_table[:, :2]).equations  # (S, 3): outward normal and offset
    margin = -np.max(sides[:, :2] @ mesh.center_mass[:2] + sides[:, 2])
    # It takes more than 10 degrees to tip the centre of mass over the border of its support.
    assert margin > (mesh.center_mass[2] - mesh.bounds[0, 2]) * np.tan(np.radians(10.0))


@pytest.mark.parametrize("name", shapes.NAMES)
def test_graspable_objects_fit_between_fingers_above_a_table(name: str) -> None:
    shape = shapes.build(name)
    narrow, wide = sorted(shape.mesh.extents[:2])
    height = shape.mesh.extents[2]
    assert 0.04 <= narrow <= 0.12
    assert wide <= 0.12
    assert 0.04 <= height <= 0.14
    # A fingertip of 12 mm radius at half height (of the torus' tube too) stays off the table.
    assert height / 2.0 > 0.012


def test_the_box_is_no_cube() -> None:
    np.testing.assert_allclose(sorted(shapes.box(0.2).mesh.extents), [0.10, 0.14, 0.20])


def test_the_same_shape_is_the_same_bytes() -> None:
    for name in shapes.NAMES:
        a, b = shapes.build(name), shapes.build(name)
        assert np.asarray(a.mesh.vertices).tobytes() == np.asarray(b.mesh.vertices).tobytes()
        assert np.asarray(a.mesh.faces).tobytes() == np.asarray(b.mesh.faces).tobytes()
        assert a.edges.tobytes() == b.edges.tobytes()


def test_every_name_has_its_function_and_its_size() -> None:
    assert set(shapes.BUILDERS) == set(shapes.GRASPABLE_SIZES) == set(shapes.NAMES)
    for name in shapes.NAMES:
        assert getattr(shapes, name) is shapes.BUILDERS[name]
        assert shapes.BUILDERS[name]().size == pytest.approx(shapes.PAPER_SIZE)


# ---------------------------------------------------------------- refusals


def test_an_unknown_shape_is_refused() -> None:
    with pytest.raises(InvalidOptionError) as error:
        shapes.build("teapot")
    assert (error.value.option, error.value.value) == ("shape", "teapot")


@pytest.mark.parametrize("size", [0.0, -0.1, np.nan, np.inf, 20.0, 0.001])
def test_a_size_that_is_no_length_in_metres_is_refused(size: float) -> None:
    for name in shapes.NAMES:
        with pytest.raises(InvalidOptionError) as error:
            shapes.build(name, size)
        assert error.value.option == "size"


@pytest.mark.parametrize(("size", "advised"), [(80.0, True), (8000.0, False), (0.001, False)])
def test_a_size_in_millimetres_is_answered_with_metres(size: float, advised: bool) -> None:
    with pytest.raises(InvalidOptionError) as error:
        shapes.build("box", size)
    assert ("80 mm are 0.08 m" in str(error.value)) == advised


def test_a_record_of_an_open_or_inverted_mesh_is_refused() -> None:
    mesh = trimesh.creation.box((0.1, 0.1, 0.1))
    Shape("cube", mesh, shapes.sharp_edges(mesh))
    inverted = mesh.copy()
    inverted.invert()
    with pytest.raises(InvalidMeshError, match="must point outward"):
        Shape("cube", inverted, np.empty((0, 2, 3)))
    mesh.update_faces(np.arange(11))
    with pytest.raises(InvalidMeshError, match="must be closed"):
        Shape("cube", mesh, np.empty((0, 2, 3)))


def test_any_mesh_makes_an_object_with_its_repairs_listed() -> None:
    mesh = trimesh.creation.box((0.1, 0.1, 0.1))
    closed = Shape.from_mesh(mesh, "cube")
    assert not closed.repairs
    npt.assert_array_equal(closed.mesh.triangles, mesh.triangles)
    damaged = mesh.copy()
    damaged.invert()
    damaged.update_faces(np.arange(11))
    repaired = Shape.from_mesh(damaged)
    assert repaired.mesh.volume == pytest.approx(1e-3)
    assert len(repaired.repairs) == 2
    assert len(damaged.faces) == 11  # the given mesh is as it was
    overlapping = trimesh.util.concatenate([mesh, mesh.copy().apply_translation((0.05, 0.0, 0.0))])
    assert Shape.from_mesh(overlapping).mesh.volume == pytest.approx(1.5e-3)


def test_a_flat_sheet_makes_no_object() -> None:
    sheet = trimesh.Trimesh([[0, 0, 0], [1, 0, 0], [0, 1, 0]], [[0, 1, 2]])
    with pytest.raises(InvalidMeshError):
        Shape.from_mesh(sheet)


def test_edges_of_another_form_are_refused() -> None:
    mesh = trimesh.creation.box((0.1, 0.1, 0.1))
    with pytest.raises(InvalidMeshError):
        Shape("cube", mesh, np.zeros((4, 3)))


def test_edges_cannot_be_changed() -> None:
    with pytest.raises(ValueError, match="read-only"):
        shapes.box().edges[0] = 0.0


# ---------------------------------------------------------------- finding


def test_a_name_finds_the_built_in_shape() -> None:
    assert shapes.find("torus").size == pytest.approx(shapes.GRASPABLE_SIZES["torus"])
    assert shapes.find("torus", size=0.2).size == pytest.approx(0.2)


def test_a_path_finds_the_file(tmp_path: Path) -> None:
    path = tmp_path / "part.stl"
    trimesh.creation.box((10.0, 20.0, 30.0)).export(path)
    assert shapes.find(str(path), units="mm").size == pytest.approx(0.03)
    assert shapes.find(path, units="mm").name == "part"


def test_a_misspelt_name_is_corrected_in_the_error() -> None:
    with pytest.raises(InvalidOptionError, match="'cylinder'"):
        shapes.find("cilinder")


def test_a_size_for_a_mesh_file_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "part.stl"
    trimesh.creation.box((0.1, 0.1, 0.1)).export(path)
    with pytest.raises(InvalidOptionError) as error:
        shapes.find(path, size=0.2)
    assert error.value.option == "size"


def test_a_missing_file_and_a_folder_are_refused_as_files(tmp_path: Path) -> None:
    for path in (tmp_path / "absent.obj", tmp_path):
        with pytest.raises(InvalidFileError) as error:
            shapes.find(path)
        assert error.value.path == path
