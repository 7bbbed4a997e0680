"""Objects from files: formats, units, repairs, refusals."""

import os
from pathlib import Path

import numpy as np
import numpy.typing as npt
import pytest
import trimesh

from lis_grasp import shapes
from lis_grasp.exceptions import (
    InvalidFileError,
    InvalidMeshError,
    InvalidOptionError,
    LisGraspWarning,
)
from lis_grasp.shapes._parts import overlapping_groups

YCB = Path(os.environ.get("LIS_GRASP_YCB", ""))


def block(
    *, at: tuple[float, float, float] = (0.3, -0.2, 0.1), fine: bool = False
) -> trimesh.Trimesh:
    """A box of 40 x 60 x 80 mm somewhere off the origin."""
    mesh = trimesh.creation.box((0.04, 0.06, 0.08))
    if fine:
        mesh = mesh.subdivide().subdivide()
    mesh.apply_translation(at)
    return mesh


_DAE = b"<COLLADA><scene/><float_array count='6'>%b</float_array></COLLADA>"
_PLY = (
    b"ply\nformat ascii 1.0\nelement vertex 3\nproperty float x\nproperty float y\n"
    b"property float z\nend_header\n"
)
VOLUME = 0.04 * 0.06 * 0.08


def write(mesh: trimesh.Trimesh, path: Path) -> Path:
    mesh.export(path)
    return path


def write_faces(vertices: npt.ArrayLike, faces: npt.ArrayLike, path: Path) -> Path:
    """Write an OFF file with exactly these faces: no library tidies them up on the way."""
    v, f = np.asarray(vertices), np.asarray(faces)
    lines = [f"OFF\n{len(v)} {len(f)} 0"]
    lines += [" ".join(repr(float(x)) for x in row) for row in v]
    lines += [" ".join(["3", *(str(int(i)) for i in row)]) for row in f]
    path.write_text("\n".join(lines) + "\n")
    return path


# ---------------------------------------------------------------- formats and units


@pytest.mark.parametrize("ending", shapes.FORMATS)
def test_every_format_gives_the_same_object_in_the_files_frame(tmp_path: Path, ending: str) -> None:
    path = tmp_path / f"block{ending}"
    mesh, stated = block(), ()
    if ending in (".gltf", ".glb", ".dae"):  # y upwards, in these as trimesh writes them
        mesh.apply_transform(trimesh.transformations.rotation_matrix(-np.pi / 2, [1, 0, 0]))
        stated = ("turned from y up to z up, as the file states",)
    if ending == ".3mf":
        mesh.apply_scale(1e3)
        stated = ("scaled from mm to metres, as the file states",)
    trimesh.Scene(mesh).export(path) if ending == ".gltf" else mesh.export(path)
    shape = shapes.load(path)
    # STL, glTF and PLY keep float32: 24 bits of coordinates below 0.5 m.
    np.testing.assert_allclose(shape.mesh.bounds, block().bounds, atol=2.0**-25)
    assert shape.mesh.volume == pytest.approx(VOLUME, rel=1e-5)
    assert shape.mesh.is_watertight
    assert len(shape.mesh.vertices) == 8
    assert len(shape.edges) == 12
    assert shape.repairs == stated
    assert shape.name == "block"


@pytest.mark.parametrize("ending", [".STL", ".Obj"])
def test_endings_may_be_in_capitals(tmp_path: Path, ending: str) -> None:
    path = tmp_path / f"block{ending}"
    path.write_bytes(write(block(), tmp_path / f"block{ending.lower()}").read_bytes())
    assert shapes.load(path).mesh.volume == pytest.approx(VOLUME, rel=1e-5)


@pytest.mark.parametrize(
    ("units", "metres"), [("m", 1.0), ("cm", 0.01), ("mm", 1e-3), ("inch", 0.0254)]
)
def test_units_scale_to_metres(tmp_path: Path, units: str, metres: float) -> None:
    mesh = block()
    mesh.apply_scale(1.0 / metres)
    shape = shapes.load(write(mesh, tmp_path / "block.ply"), units)
    np.testing.assert_allclose(shape.mesh.bounds, block().bounds, rtol=1e-6)
    assert shape.size == pytest.approx(0.08, rel=1e-6)


def test_polygons_and_texture_seams_of_an_obj_are_read(tmp_path: Path) -> None:
    x, y, z = 0.02, 0.03, 0.04
    corners = [(sx * x, sy * y, sz * z) for sx in (-1, 1) for sy in (-1, 1) for sz in (-1, 1)]
    quads = [(1, 2, 4, 3), (5, 7, 8, 6), (1, 5, 6, 2), (3, 4, 8, 7), (1, 3, 7, 5), (2, 6, 8, 4)]
    lines = ["mtllib absent.mtl", "usemtl gone"]
    lines += [f"v {a} {b} {c}" for a, b, c in corners]
    lines += ["vt 0 0", "vt 1 0", "vt 1 1", "vt 0 1"]
    lines += ["f " + " ".join(f"{v}/{i + 1}" for i, v in enumerate(quad)) for quad in quads]
    path = tmp_path / "textured.obj"
    path.write_text("\n".join(lines))
    shape = shapes.load(path)
    assert shape.mesh.volume == pytest.approx(VOLUME)
    assert len(shape.mesh.vertices) == 8


def test_the_parts_of_a_scene_are_one_object_where_they_stand(tmp_path: Path) -> None:
    scene = trimesh.Scene()
    scene.add_geometry(block(at=(0.0, 0.0, 0.0)))
    scene.add_geometry(
        block(at=(0.0, 0.0, 0.0)), transform=trimesh.transformations.translation_matrix([0.1, 0, 0])
    )
    scene.export(tmp_path / "two.glb")
    shape = shapes.load(tmp_path / "two.glb")
    assert shape.mesh.volume == pytest.approx(2.0 * VOLUME, rel=1e-5)
    assert shape.mesh.extents[0] == pytest.approx(0.14, rel=1e-5)


# ---------------------------------------------------------------- repairs


def test_a_sound_mesh_is_left_as_it_is(tmp_path: Path) -> None:
    mesh = shapes.mallet().mesh
    shape = shapes.load(write_faces(mesh.vertices, mesh.faces, tmp_path / "mallet.off"))
    np.testing.assert_array_equal(shape.mesh.vertices, mesh.vertices)
    np.testing.assert_array_equal(shape.mesh.faces, mesh.faces)
    assert shape.repairs == ()


def test_an_inverted_mesh_is_turned_outward(tmp_path: Path) -> None:
    mesh = block()
    mesh.invert()
    shape = shapes.load(write(mesh, tmp_path / "block.ply"))
    assert shape.mesh.volume == pytest.approx(VOLUME, rel=1e-5)
    assert shape.repairs == ("turned 12 faces outward",)


def test_single_inverted_faces_are_turned_outward(tmp_path: Path) -> None:
    mesh = block(fine=True)
    faces = np.array(mesh.faces)
    faces[[3, 77]] = faces[[3, 77], ::-1]
    shape = shapes.load(write_faces(mesh.vertices, faces, tmp_path / "block.off"))
    assert shape.mesh.volume == pytest.approx(VOLUME)
    assert shape.repairs == ("turned 2 faces outward",)


def test_holes_in_flat_faces_are_closed_flat(tmp_path: Path) -> None:
    mesh = block(fine=True)
    on_top = np.flatnonzero(mesh.triangles_center[:, 2] > mesh.bounds[1, 2] - 1e-9)
    in_front = np.flatnonzero(mesh.triangles_center[:, 0] > mesh.bounds[1, 0] - 1e-9)
    faces = np.delete(mesh.faces, [on_top[0], *in_front[4:8]], axis=0)
    shape = shapes.load(write_faces(mesh.vertices, faces, tmp_path / "block.off"))
    assert shape.mesh.is_watertight
    assert shape.mesh.volume == pytest.approx(VOLUME)
    assert shape.mesh.area == pytest.approx(block().area)
    assert len(shape.repairs) == 1
    assert shape.repairs[0].startswith("closed ")


def test_a_hole_that_winds_is_closed_without_folding_over(tmp_path: Path) -> None:
    mesh = block(at=(0.0, 0.0, 0.0), fine=True).subdivide()
    x, y, z = mesh.triangles_center.T
    on_top = z > 0.04 - 1e-9
    # Three sides of a frame round the middle of the top: no point sees all of its border.
    frame = on_top & (np.abs(x) < 0.015) & (np.abs(y) < 0.0225)
    frame &= ~((np.abs(x) < 0.01) & (y < 0.015) & (y > -0.03))
    shape = shapes.load(write_faces(mesh.vertices, mesh.faces[~frame], tmp_path / "frame.off"))
    assert frame.sum() > 20
    assert shape.mesh.area == pytest.approx(mesh.area)
    assert shape.mesh.volume == pytest.approx(VOLUME)
    assert shape.mesh.area_faces.min() > 0.0


def test_an_open_box_becomes_solid(tmp_path: Path) -> None:
    mesh = block()
    faces = mesh.faces[mesh.face_normals[:, 2] < 0.9]
    shape = shapes.load(write_faces(mesh.vertices, faces, tmp_path / "open.off"))
    assert shape.mesh.volume == pytest.approx(VOLUME)
    assert shape.repairs == ("closed 1 hole, the largest 200 mm around",)


def test_degenerate_and_double_faces_are_dropped(tmp_path: Path) -> None:
    mesh = block()
    faces = np.vstack([mesh.faces, [[0, 0, 1]], mesh.faces[4:5, [1, 2, 0]]])
    shape = shapes.load(write_faces(mesh.vertices, faces, tmp_path / "block.off"))
    assert len(shape.mesh.faces) == 12
    assert shape.repairs == (
        "dropped 1 face without area",
        "dropped 1 face that was there twice",
    )


def test_a_fin_is_dropped(tmp_path: Path) -> None:
    mesh = block()
    edge = mesh.faces[0, :2]
    vertices = np.vstack([mesh.vertices, mesh.bounds[1] + 0.02])
    faces = np.vstack([mesh.faces, [[edge[0], edge[1], 8]]])
    shape = shapes.load(write_faces(vertices, faces, tmp_path / "fin.off"))
    assert shape.mesh.is_watertight
    assert shape.mesh.volume == pytest.approx(VOLUME)
    assert any("more than two faces" in repair for repair in shape.repairs)


def test_blocks_that_share_a_face_become_one(tmp_path: Path) -> None:
    pair = trimesh.util.concatenate([block(), block(at=(0.34, -0.2, 0.1))])
    shape = shapes.load(write(pair, tmp_path / "pair.stl"))
    assert shape.mesh.volume == pytest.approx(2.0 * VOLUME, rel=1e-5)
    assert shape.mesh.area == pytest.approx(
        2.0 * (0.08 * 0.06 + 0.08 * 0.08 + 0.06 * 0.08), rel=1e-5
    )
    assert shape.repairs == ("united 2 parts that touch",)


def test_blocks_that_share_an_edge_only_are_two_solids(tmp_path: Path) -> None:
    pair = trimesh.util.concatenate([block(), block(at=(0.34, -0.14, 0.1))])
    shape = shapes.load(write(pair, tmp_path / "pair.stl"))
    assert shape.mesh.volume == pytest.approx(2.0 * VOLUME, rel=1e-5)
    assert shape.mesh.is_watertight


def test_overlapping_parts_are_united(tmp_path: Path) -> None:
    pair = trimesh.util.concatenate([block(), block(at=(0.32, -0.18, 0.12))])
    shape = shapes.load(write(pair, tmp_path / "pair.ply"))
    overlap = 0.02 * 0.04 * 0.06
    assert shape.mesh.volume == pytest.approx(2.0 * VOLUME - overlap, rel=1e-5)
    assert shape.repairs == ("united 2 parts that touch",)


def test_parts_far_from_the_origin_are_united_as_precisely(tmp_path: Path) -> None:
    pair = trimesh.util.concatenate([block(), block(at=(0.32, -0.18, 0.12))])
    pair.apply_translation((1000.0, 0.0, 0.0))
    shape = shapes.load(write_faces(pair.vertices, pair.faces, tmp_path / "pair.off"))
    overlap = 0.02 * 0.04 * 0.06
    # In single precision vertices would be 0.06 mm off there.
    assert shape.mesh.volume == pytest.approx(2.0 * VOLUME - overlap, rel=1e-6)


def test_a_heap_of_shreds_is_refused(tmp_path: Path) -> None:
    rng = np.random.default_rng(0)
    splinters = [
        trimesh.Trimesh(
            rng.uniform(-0.1, 0.1, (4, 3)), [[0, 1, 2], [0, 3, 1], [1, 3, 2], [2, 3, 0]]
        )
        for _ in range(200)
    ]
    heap = trimesh.util.concatenate(splinters)
    with pytest.raises(InvalidMeshError):
        shapes.load(write(heap, tmp_path / "heap.ply"))


def test_parts_apart_stay_apart(tmp_path: Path) -> None:
    pair = trimesh.util.concatenate([block(), block(at=(0.4, -0.2, 0.1))])
    shape = shapes.load(write(pair, tmp_path / "pair.ply"))
    assert shape.mesh.volume == pytest.approx(2.0 * VOLUME, rel=1e-5)
    assert shape.repairs == ()


def test_loose_specks_are_dropped(tmp_path: Path) -> None:
    speck = trimesh.creation.box((1e-4, 1e-4, 1e-4))
    scan = trimesh.util.concatenate([block(), speck])
    shape = shapes.load(write(scan, tmp_path / "scan.ply"))
    np.testing.assert_allclose(shape.mesh.bounds, block().bounds, atol=1e-6)
    assert shape.repairs == ("dropped 1 loose speck",)


def test_a_closed_cavity_stays_a_cavity(tmp_path: Path) -> None:
    hollow = trimesh.creation.box((0.02, 0.02, 0.02))
    hollow.apply_translation(block().centroid)
    hollow.invert()
    shape = shapes.load(write(trimesh.util.concatenate([block(), hollow]), tmp_path / "hollow.ply"))
    assert shape.mesh.volume == pytest.approx(VOLUME - 0.02**3, rel=1e-5)
    assert shape.repairs == ()


@pytest.mark.parametrize("at", [(0.4, -0.2, 0.1), (0.32, -0.19, 0.105)])
def test_a_part_that_is_inside_out_is_a_part_and_no_cavity(tmp_path: Path, at: tuple) -> None:
    # As a mirrored copy comes out of a CAD program: apart, or running into the other.
    both = [block(), block(at=at)]
    solid = trimesh.util.concatenate(both)
    wanted = shapes.load(write(solid, tmp_path / "solid.ply"))
    both[1].invert()
    shape = shapes.load(write(trimesh.util.concatenate(both), tmp_path / "mirrored.ply"))
    assert shape.mesh.volume == pytest.approx(wanted.mesh.volume, rel=1e-6)
    np.testing.assert_allclose(shape.mesh.center_mass, wanted.mesh.center_mass, atol=1e-6)
    assert "turned 1 part outward" in shape.repairs


@pytest.mark.parametrize("solid_inward", [False, True])
@pytest.mark.parametrize("sheet_turned", [False, True])
def test_an_open_sheet_does_not_turn_a_solid_inside_out(
    tmp_path: Path, solid_inward: bool, sheet_turned: bool
) -> None:
    # A sheet of 200 x 300 mm, bent by 20 mm: two triangles, which enclose 0.2 l with the line
    # between their far corners.
    sheet = trimesh.Trimesh(
        [[0.2, 0, -0.3], [0.4, 0, -0.3], [0.4, 0.3, -0.28], [0.2, 0.3, -0.3]],
        [[0, 1, 2], [0, 2, 3]],
    )
    solid = block()
    if solid_inward:
        solid.invert()
    if sheet_turned:
        sheet.invert()
    shape = shapes.load(
        write(trimesh.util.concatenate([solid, sheet]), tmp_path / "with_sheet.ply")
    )
    volume = 0.2 * 0.3 * 0.02 / 6.0
    assert shape.mesh.volume == pytest.approx(VOLUME + volume, rel=1e-5)


def with_sliver(mesh: trimesh.Trimesh) -> tuple[np.ndarray, np.ndarray]:
    """Split the first face at the middle of an edge, but leave its neighbour: a sliver between."""
    a, b, c = (int(v) for v in mesh.faces[0])
    middle = len(mesh.vertices)
    vertices = np.vstack([mesh.vertices, mesh.vertices[[a, b]].mean(axis=0)])
    split = [[a, middle, c], [middle, b, c], [a, b, middle]]
    return vertices, np.vstack([mesh.faces[1:], split])


def test_a_sliver_is_flipped_away(tmp_path: Path) -> None:
    vertices, faces = with_sliver(block())
    assert np.isclose(trimesh.Trimesh(vertices, faces, process=False).area_faces.min(), 0.0)
    shape = shapes.load(write_faces(vertices, faces, tmp_path / "sliver.off"))
    assert len(shape.mesh.faces) == 14
    assert shape.mesh.volume == pytest.approx(VOLUME, rel=1e-9)
    # The smallest triangle is a quarter of the smallest face.
    assert shape.mesh.area_faces.min() == pytest.approx(0.25 * 0.04 * 0.06)
    assert len(shape.repairs) == 1


def test_groups_of_overlapping_boxes_are_those_of_all_pairs() -> None:
    rng = np.random.default_rng(0)
    low = rng.random((200, 3))
    high = low + 0.12 * rng.random((200, 3))
    meet = np.all((low[:, None] <= high) & (high[:, None] >= low), axis=-1)
    reached = meet
    for _ in range(8):  # 2^8 boxes in a chain
        reached = (reached.astype(float) @ reached.astype(float)) > 0
    expected = {tuple(np.flatnonzero(row)) for row in reached}
    assert 20 < len(expected) < 180
    assert {tuple(sorted(group)) for group in overlapping_groups(low, high)} == expected


@pytest.mark.by_default("0", "1")
@pytest.mark.parametrize("seed", range(6))
def test_meshes_with_missing_and_turned_faces_are_closed_and_outward(
    tmp_path: Path, seed: int
) -> None:
    rng = np.random.default_rng(seed)
    mesh = shapes.mallet().mesh
    faces = np.array(mesh.faces)
    turned = rng.choice(len(faces), 30, replace=False)
    faces[turned] = faces[turned, ::-1]
    faces = np.delete(faces, rng.choice(len(faces), 60, replace=False), axis=0)
    strays = rng.choice(len(mesh.vertices), (8, 3), replace=False)
    shape = shapes.load(
        write_faces(mesh.vertices, np.vstack([faces, strays]), tmp_path / "broken.off")
    )
    assert shape.mesh.is_watertight
    assert shape.mesh.is_winding_consistent
    assert shape.mesh.volume == pytest.approx(mesh.volume, rel=0.01)
    assert shape.repairs


@pytest.mark.skipif(not YCB.is_dir() or not os.environ.get("LIS_GRASP_YCB"), reason="no YCB folder")
def test_scans_come_out_closed_and_hardly_changed() -> None:
    paths = sorted(YCB.glob("*.ply"))
    assert paths
    for path in paths:
        raw = trimesh.load_mesh(path)
        shape = shapes.load(path)
        assert shape.mesh.is_watertight
        assert shape.mesh.volume == pytest.approx(abs(raw.volume), rel=0.01)
        _, distances, _ = trimesh.proximity.closest_point(raw, shape.mesh.vertices)
        assert distances.max() < 0.01  # the middle of a hole 5 cm wide, as far from its border
        assert bool(shape.repairs) != raw.is_watertight


# ---------------------------------------------------------------- refusals


@pytest.mark.parametrize(
    ("name", "content", "message"),
    [
        ("part.step", b"ISO-10303-21;", "must end in one of"),
        ("part.stl", b"", "is empty"),
        ("part.stl", b"solid nothing\nendsolid nothing\n", "has no faces|cannot be read as STL"),
        ("part.stl", b"\x00" * 50, "cannot be read as STL|has no faces"),
        ("part.ply", b"not a ply file at all", "cannot be read as PLY"),
        ("part.obj", b"nothing of use\n", "cannot be read as OBJ|has no faces"),
        ("part.off", b"OFF\n1 0", "cannot be read as OFF|has no faces"),
        ("part.gltf", b"{}", "no faces"),
        ("part.glb", b"rubbish of some length, longer than a header", "cannot be read as GLB"),
        (
            "cloud.ply",
            b"ply\nformat ascii 1.0\nelement vertex 1\nproperty float x\nproperty float y\n"
            b"property float z\nend_header\n0 0 0\n",
            "has no faces",
        ),
        (
            "part.off",
            b"OFF\n3 1 0\n0 0 0\n.1 0 0\n0 .1 0\n3 0 1 7\n",
            "vertices it lacks|cannot be read",
        ),
        ("part.obj", b"v 0 0 0\nv .1 0 0\nv 0 .1 0\nf 0 1 2\n", "index 0, and OBJ counts from 1"),
        ("part.obj", b"v 0 0 zero\nv .1 0 0\nv 0 .1 0\nf 1 2 3\n", "'v 0 0 zero' is a vertex that"),
        ("part.obj", b"\0" * 84, "it is binary"),
        ("part.obj", b"v 0 0 0\nv .1 0 0\n", "has no faces.*if it is a scan, its points as .ply"),
        ("part.stl", b"\0" * 60, "has 60 bytes, fewer than the start"),
        ("part.stl", b"print(1)\n", "text without facets"),
        ("part.stl", b"# of a program\nv 0 0 0\n", "is an OBJ file: name it .obj"),
        ("part.glb", b'{"asset": {"version": "2.0"}}', "a glTF of text: name it .gltf"),
        ("part.gltf", b'{"asset"', "line 1 is no JSON, or it is cut off"),
        ("part.dae", b"<COLLADA><asset>", "line 1 is no XML, or it is cut off"),
        ("part.dae", _DAE % b"1 2 3", "announces 6 numbers, and has 3"),
        ("part.dae", _DAE % b"1 2 3 4 5 six", "has 'six' where a number is needed"),
        (
            "part.obj",
            b"v 0 0 0\nv .1 0 0\nv 0 .1 0\nf 1 2 3\nf 1 2",
            "'f 1 2' has fewer than three",
        ),
        ("part.ply", b"ply\nformat asci 1.0\nend_header\n", "line 2 of its header is no PLY"),
        ("part.ply", _PLY + b"0 0 0\n.1 0 zero\n", "row 2 of its 3 rows of vertex is not as"),
        ("part.off", b"OFF\n1 0 0\n0 0 zero\n", "has 'zero' where a number is needed"),
        ("part.gltf", b'{"asset": {"version": "1.0"}}', "cannot be read as GLTF"),
    ],
)
def test_a_file_without_a_surface_is_refused(
    tmp_path: Path, name: str, content: bytes, message: str
) -> None:
    path = tmp_path / name
    path.write_bytes(content)
    with pytest.raises(InvalidFileError, match=message) as caught:
        shapes.load(path)
    assert caught.value.path == path
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize("kept", [0.5, 1.0])
def test_a_text_of_stl_without_its_end_is_read_and_that_is_said(
    tmp_path: Path, kept: float
) -> None:
    text, path = trimesh.exchange.stl.export_stl_ascii(block()), tmp_path / "cut.stl"
    facets = text.split("endfacet")
    path.write_text("endfacet".join(facets[: round(12 * kept)]) + "endfacet\n")
    with pytest.warns(LisGraspWarning, match="ends without 'endsolid': if a download stopped"):
        shape = shapes.load(path)
    assert len(shape.repairs) == (0 if kept == 1.0 else 1)  # the hole that is closed


@pytest.mark.parametrize("ending", [".stl", ".ply", ".glb"])
def test_single_precision_that_distorts_an_object_far_from_the_origin_is_said(
    tmp_path: Path, ending: str
) -> None:
    # Steps are 8e-6 m at 100 m, and 1e-3 m at 10 km; 0.5 % of 0.08 m are 4e-4 m.
    near, far = (tmp_path / f"{name}{ending}" for name in ("near", "far"))
    assert shapes.load(write(block(at=(100.0, 0.0, 0.0)), near)).mesh.volume == pytest.approx(
        VOLUME, rel=3 * 8e-6 / 0.04
    )
    with pytest.raises(InvalidFileError) as error:
        shapes.load(write(block(at=(1e4, 0.0, 0.0)), far))
    assert error.value.path == far


@pytest.mark.parametrize("last", ["endloop", "vertex"])
def test_a_text_of_stl_that_is_cut_off_in_a_facet_is_refused(tmp_path: Path, last: str) -> None:
    text = trimesh.exchange.stl.export_stl_ascii(block())
    path = tmp_path / "cut.stl"
    path.write_text(text[: text.index(last, len(text) // 2) + 5])
    with pytest.raises(InvalidFileError) as error:
        shapes.load(path)
    assert error.value.path == path


def test_unknown_units_are_refused(tmp_path: Path) -> None:
    with pytest.raises(InvalidOptionError) as error:
        shapes.load(write(block(), tmp_path / "block.stl"), "feet")
    assert (error.value.option, error.value.value) == ("units", "feet")


@pytest.mark.parametrize(
    ("scale", "message"),
    [
        (1000.0, r"80 m large when read in m.*`units` mm \(then 0\.08 m\)"),
        # In centimetres it would be 0.8 m: no object of a hand.
        (1000.0, r"m: `units` mm \(then 0\.08 m\) would fit$"),
        (30.0, r"m: `units` cm \(then 0\.024 m\) or inch \(then 0\.061 m\) would fit$"),
        (0.01, r"0\.0008 m large when read in m.*no unit would fit"),
        (1e6, "no unit would fit"),
    ],
)
def test_mistaken_units_are_refused_with_those_that_fit(
    tmp_path: Path, scale: float, message: str
) -> None:
    mesh = block()
    mesh.apply_scale(scale)
    with pytest.raises(InvalidMeshError, match=message):
        shapes.load(write(mesh, tmp_path / "block.ply"))


@pytest.mark.parametrize("copies", [1, 2])
def test_a_flat_sheet_is_refused(tmp_path: Path, copies: int) -> None:
    vertices = [[0, 0, 0], [0.1, 0, 0], [0.1, 0.1, 0], [0, 0.1, 0], [0.05, 0.05, 0]]
    faces = [[0, 1, 4], [1, 2, 4], [2, 3, 4], [3, 0, 4]]
    if copies == 2:  # both sides of the sheet
        faces += [face[::-1] for face in faces]
    path = write_faces(vertices, faces, tmp_path / "sheet.off")
    with pytest.raises(InvalidMeshError) as caught:
        shapes.load(path)
    assert str(path) in str(caught.value)


@pytest.mark.parametrize("damage", [np.nan, np.inf])
def test_vertices_that_are_no_numbers_are_refused(tmp_path: Path, damage: float) -> None:
    mesh = block()
    vertices = np.array(mesh.vertices)
    vertices[3, 1] = damage
    path = write_faces(vertices, mesh.faces, tmp_path / "nan.off")
    with pytest.raises((InvalidMeshError, InvalidFileError)):
        shapes.load(path)
