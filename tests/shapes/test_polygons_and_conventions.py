"""Mesh files as programs write them: polygons, relative indices, units, axes, announced counts."""

from __future__ import annotations

import json
import struct
import zipfile
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
import trimesh
from plyfile import PlyData, PlyElement

from lis_grasp import shapes
from lis_grasp.exceptions import InvalidFileError, InvalidMeshError, InvalidOptionError
from lis_grasp.io._mesh_text import triangulate
from lis_grasp.io.limits import ReadError
from lis_grasp.robots.link_bodies import load_link_mesh
from lis_grasp.typing import FloatArray

Polygons = list[list[int]]

# Outlines in the plane: a U, an L, a comb and a star about its centre; none is covered by a fan.
_OUTLINES = {
    "u": [(0, 0), (60, 0), (60, 60), (40, 60), (40, 20), (20, 20), (20, 60), (0, 60)],
    "l": [(0, 0), (60, 0), (60, 20), (20, 20), (20, 60), (0, 60)],
    "comb": [(0, 0), (70, 0), *((70 - 10 * k, 60 if k % 4 < 2 else 20) for k in range(8))],
    "star": [
        (round((30 if k % 2 else 12) * np.cos(np.pi * k / 5), 6), 30 * np.sin(np.pi * k / 5))
        for k in range(10)
    ],
}


def _prism(outline: list[tuple[float, float]], first: int) -> tuple[FloatArray, Polygons]:
    """Return a prism 30 mm high with one polygon at each end, which begins at corner `first`."""
    n = len(outline)
    flat = np.array(outline, dtype=np.float64)
    vertices = 1e-3 * np.vstack([np.column_stack([flat, np.full(n, z)]) for z in (0.0, 30.0)])
    end = np.roll(np.arange(n), first)
    sides = [[k, (k + 1) % n, n + (k + 1) % n, n + k] for k in range(n)]
    return vertices, [end[::-1].tolist(), (n + end).tolist(), *sides]


def _true_size(outline: list[tuple[float, float]]) -> tuple[float, float]:
    """Return area [m^2] and volume [m^3] of a prism by the shoelace formula."""
    x, y = 1e-3 * np.array(outline, dtype=np.float64).T
    base = 0.5 * abs(x @ np.roll(y, -1) - y @ np.roll(x, -1))
    around = np.hypot(np.roll(x, -1) - x, np.roll(y, -1) - y).sum()
    return 2.0 * base + 0.03 * around, 0.03 * base


def _obj(path: Path, vertices: FloatArray, polygons: Polygons) -> None:
    lines = [f"v {x:.9g} {y:.9g} {z:.9g}" for x, y, z in vertices]
    lines += ["f " + " ".join(str(i + 1) for i in polygon) for polygon in polygons]
    path.write_text("\n".join(lines) + "\n")


def _off(path: Path, vertices: FloatArray, polygons: Polygons) -> None:
    lines = ["OFF # made by hand", f"{len(vertices)} {len(polygons)} 0"]
    lines += [f"{x:.9g} {y:.9g} {z:.9g}" for x, y, z in vertices]
    lines += [" ".join(map(str, [len(polygon), *polygon, 255, 0, 0])) for polygon in polygons]
    path.write_text("\n".join(lines) + "\n")


def _ply(path: Path, vertices: FloatArray, polygons: Polygons, *, text: bool = False) -> None:
    rows = np.array([tuple(v) for v in vertices], dtype=[(axis, "f8") for axis in "xyz"])
    faces = np.empty(len(polygons), dtype=[("vertex_indices", "O")])
    faces["vertex_indices"] = [np.array(polygon, dtype=np.int32) for polygon in polygons]
    elements = [PlyElement.describe(rows, "vertex"), PlyElement.describe(faces, "face")]
    PlyData(elements, text=text).write(str(path))


def _dae(path: Path, vertices: FloatArray, polygons: Polygons) -> None:
    corners = [f"{i} 0" for polygon in polygons for i in polygon]
    path.write_text(
        '<COLLADA xmlns="http://www.collada.org/2005/11/COLLADASchema" version="1.4.1"><asset>'
        '<unit meter="1"/><up_axis>Z_UP</up_axis></asset><library_geometries><geometry id="g">'
        f'<mesh><source id="p"><float_array id="a" count="{vertices.size}">'
        f"{' '.join(map(str, vertices.ravel()))}</float_array><technique_common><accessor "
        f'source="#a" count="{len(vertices)}" stride="3"><param name="X" type="float"/><param '
        'name="Y" type="float"/><param name="Z" type="float"/></accessor></technique_common>'
        '</source><source id="n"><float_array id="b" count="3">0 0 1</float_array>'
        '<technique_common><accessor source="#b" count="1" stride="3"><param name="X" type="float"'
        '/><param name="Y" type="float"/><param name="Z" type="float"/></accessor>'
        '</technique_common></source><vertices id="v"><input semantic="POSITION" source="#p"/>'
        f'</vertices><polylist count="{len(polygons)}"><input semantic="VERTEX" source="#v" '
        'offset="0"/><input semantic="NORMAL" source="#n" offset="1"/>'
        f"<vcount>{' '.join(str(len(p)) for p in polygons)}</vcount><p>{' '.join(corners)}</p>"
        "</polylist></mesh></geometry></library_geometries><library_visual_scenes><visual_scene "
        'id="s"><node><instance_geometry url="#g"/></node></visual_scene></library_visual_scenes>'
        '<scene><instance_visual_scene url="#s"/></scene></COLLADA>'
    )


_WRITERS: dict[str, Callable[[Path, FloatArray, Polygons], None]] = {
    "obj": _obj,
    "off": _off,
    "ply": _ply,
    "dae": _dae,
}


@pytest.mark.parametrize("ending", _WRITERS)
@pytest.mark.parametrize("outline", _OUTLINES)
def test_polygons_keep_their_outline_wherever_they_begin(
    outline: str, ending: str, tmp_path: Path
) -> None:
    area, volume = _true_size(_OUTLINES[outline])
    for first in range(len(_OUTLINES[outline])):
        path = tmp_path / f"part{first}.{ending}"
        _WRITERS[ending](path, *_prism(_OUTLINES[outline], first))
        shape = shapes.load(path)
        assert shape.mesh.area == pytest.approx(area, rel=1e-6)
        assert shape.mesh.volume == pytest.approx(volume, rel=1e-6)
        assert shape.repairs == ()
        assert load_link_mesh(path, None).area == pytest.approx(area, rel=1e-6)


def test_a_polygon_whose_outline_crosses_itself_is_refused(tmp_path: Path) -> None:
    with pytest.raises(ReadError):
        triangulate(np.array([[0, 0, 0], [2, 2, 0], [2, 0, 0], [0, 1, 0]], float), [[0, 1, 2, 3]])


def test_a_polygon_with_a_bridge_to_its_hole_keeps_the_hole() -> None:
    outer, inner = (
        [(0, 0), (4, 0), (4, 4), (0, 4), (0, 0)],
        [(1, 1), (1, 3), (3, 3), (3, 1), (1, 1)],
    )
    points = np.array([(x, y, 0.0) for x, y in outer + inner])
    (triangles,) = triangulate(points, [list(range(10))])
    a, b, c = np.swapaxes(points[triangles], 0, 1)
    assert 0.5 * np.cross(b - a, c - a)[:, 2].sum() == pytest.approx(16.0 - 4.0)


@pytest.mark.parametrize("normals", [False, True])
def test_relative_indices_count_from_their_line(normals: bool, tmp_path: Path) -> None:
    # Two boxes, each face right after its vertices; the second is 90 mm above the first.
    lines, boxes = [], []
    for height in (0.0, 0.09):
        box = trimesh.creation.box((0.06, 0.05, 0.04))
        box.apply_translation([0, 0, height])
        boxes.append(box)
        for triangle, normal in zip(box.triangles, box.face_normals, strict=True):
            lines += [f"v {x:.9g} {y:.9g} {z:.9g}" for x, y, z in triangle]
            lines += ["vn {} {} {}".format(*normal)] if normals else []
            lines.append("f -3//-1 -2//-1 -1//-1" if normals else "f -3 -2 \\\n -1")
    path = tmp_path / "boxes.obj"
    path.write_text("\n".join(lines))
    for mesh in (shapes.load(path).mesh, load_link_mesh(path, None)):
        np.testing.assert_allclose(mesh.bounds, trimesh.util.concatenate(boxes).bounds, atol=1e-9)
        assert mesh.volume == pytest.approx(2 * 0.06 * 0.05 * 0.04)


@pytest.mark.parametrize(
    "forms",
    [
        ["f {} {} {}", "f {}/1 {}/1 {}/2"],
        ["f {}//1 {}//1 {}//1", "f {}/1/1 {}/2/1 {}/1/1"],
        ["f {}/1/1 {}//1 {}"],
        ["f\t{}  {} {}  "],
        ["  f {} {} {} # a face"],
        ["f {}/ {}/ {}/", "f {}// {}// {}//"],
    ],
)
@pytest.mark.parametrize("end", ["\n", "\r\n", "\r"])
def test_faces_of_an_obj_are_read_in_every_form(forms: list, end: str, tmp_path: Path) -> None:
    box = trimesh.creation.box((0.04, 0.05, 0.06))
    lines = [f"v\t{x:g} {y:g}\t{z:g}" for x, y, z in box.vertices]
    lines += ["vt 0 0", "vt 1 0", "vn 0 0 1"]
    lines += [forms[n % len(forms)].format(*(face + 1)) for n, face in enumerate(box.faces)]
    (tmp_path / "a.obj").write_bytes(end.join(lines).encode())
    for mesh in (shapes.load(tmp_path / "a.obj").mesh, load_link_mesh(tmp_path / "a.obj", None)):
        np.testing.assert_allclose(mesh.extents, (0.04, 0.05, 0.06))
        assert mesh.volume == pytest.approx(0.04 * 0.05 * 0.06)


@pytest.mark.parametrize("count", [0, 10, 20])
def test_a_binary_stl_must_have_as_many_triangles_as_it_announces(
    count: int, tmp_path: Path
) -> None:
    content = bytearray(trimesh.creation.box((0.05, 0.04, 0.03)).export(file_type="stl"))
    content[80:84] = struct.pack("<I", count)
    (tmp_path / "a.stl").write_bytes(content)
    if count == 10:  # what follows is of another program, but two faces are missing then
        assert "closed" in shapes.load(tmp_path / "a.stl").repairs[0]
        return
    with pytest.raises(InvalidFileError) as error:
        shapes.load(tmp_path / "a.stl")
    assert error.value.path == tmp_path / "a.stl"


@pytest.mark.parametrize(
    ("old", "new"),
    [
        (b"solid", b"solid facet vertex 1 2 3\n#"),
        (b"e-02", b"D-02"),
        (b"\n", b"\r\n"),
        (b"endsolid", b""),
        (b"endsolid", b"\0\0endsolid"),
    ],
)
def test_texts_of_stl_are_read_whatever_wrote_them(old: bytes, new: bytes, tmp_path: Path) -> None:
    box = trimesh.creation.box((0.05, 0.04, 0.03))
    text = box.export(file_type="stl_ascii").encode()
    path = tmp_path / "a.stl"
    path.write_bytes(text.replace(old, new, 1 if old == b"solid" else -1))
    assert shapes.load(path).mesh.volume == pytest.approx(6e-5)
    path.write_bytes(text[: text.rindex(b"vertex")])
    with pytest.raises(InvalidFileError) as error:
        shapes.load(path)
    assert error.value.path == path


def test_a_binary_stl_may_have_bytes_after_the_last_triangle(tmp_path: Path) -> None:
    content = trimesh.creation.box((0.05, 0.04, 0.03)).export(file_type="stl")
    (tmp_path / "a.stl").write_bytes(content + bytes(range(37)))
    assert shapes.load(tmp_path / "a.stl").mesh.volume == pytest.approx(6e-5)


# ---------------------------------------------------------------- units and axes


def _block() -> trimesh.Trimesh:
    return trimesh.creation.box((0.04, 0.05, 0.12))


@pytest.mark.parametrize("ending", ["obj", "stl", "ply", "off"])
def test_the_axis_upwards_is_given_where_the_format_has_none(ending: str, tmp_path: Path) -> None:
    path = tmp_path / f"a.{ending}"
    _block().export(path)
    np.testing.assert_allclose(shapes.load(path).mesh.extents, (0.04, 0.05, 0.12))
    turned = shapes.load(path, up="y")
    np.testing.assert_allclose(turned.mesh.extents, (0.04, 0.12, 0.05))
    assert turned.repairs == ()
    with pytest.raises(InvalidOptionError) as error:
        shapes.load(path, up="x")
    assert (error.value.option, error.value.value) == ("up", "x")


def test_gltf_is_in_metres_with_y_up_and_options_must_agree(tmp_path: Path) -> None:
    path = tmp_path / "a.glb"
    _block().export(path)
    for options in ({}, {"units": "m"}, {"up": "y"}):
        np.testing.assert_allclose(
            shapes.load(path, **options).mesh.extents, (0.04, 0.12, 0.05), rtol=1e-6
        )
    with pytest.raises(InvalidOptionError) as error:
        shapes.load(path, units="mm")
    assert error.value.option == "units"
    with pytest.raises(InvalidOptionError) as error:
        shapes.load(path, up="z")
    assert error.value.option == "up"


@pytest.mark.by_default("None-0.001", "inch-0.0254")
@pytest.mark.parametrize(
    ("unit", "metres"), [("millimeter", 1e-3), ("inch", 0.0254), ("micron", 1e-6), (None, 1e-3)]
)
def test_units_and_placements_of_3mf_are_used(
    unit: str | None, metres: float, tmp_path: Path
) -> None:
    box = trimesh.creation.box(np.array([0.04, 0.05, 0.06]) / metres)
    vertices = "".join(f'<vertex x="{x}" y="{y}" z="{z}"/>' for x, y, z in box.vertices)
    faces = "".join(f'<triangle v1="{a}" v2="{b}" v3="{c}"/>' for a, b, c in box.faces)
    stated = "" if unit is None else f'unit="{unit}"'
    # Two components, 0.2 m apart along x; the item turns x to y.
    away = 0.2 / metres
    model = (
        f'<model xmlns="http://schemas.microsoft.com/3dmanufacturing/core/2015/02" {stated}>'
        f'<resources><object id="1"><mesh><vertices>{vertices}</vertices><triangles>{faces}'
        '</triangles></mesh></object><object id="2"><components><component objectid="1"/>'
        f'<component objectid="1" transform="1 0 0 0 1 0 0 0 1 {away} 0 0"/></components></object>'
        '</resources><build><item objectid="2" transform="0 1 0 -1 0 0 0 0 1 0 0 0"/></build>'
        "</model>"
    )
    path = tmp_path / "a.3mf"
    links = '<R xmlns="r"><Relationship Target="/3D/m.model" Type="http://x/3dmodel"/></R>'

    def write(text: str) -> None:
        with zipfile.ZipFile(path, "w") as archive:
            archive.writestr("_rels/.rels", links)
            archive.writestr("3D/m.model", text)

    write(model)
    shape = shapes.load(path)
    np.testing.assert_allclose(shape.mesh.extents, (0.05, 0.24, 0.06), rtol=1e-9)
    assert shape.mesh.volume == pytest.approx(2 * 0.04 * 0.05 * 0.06)
    assert "as the file states" in shape.repairs[0]
    assert load_link_mesh(path, None).extents == pytest.approx((0.05, 0.24, 0.06))
    with pytest.raises(InvalidOptionError) as error:
        shapes.load(path, units="m")
    assert (error.value.option, error.value.value) == ("units", "m")
    write(model.replace("<model ", '<model xmlns:b="http://x/beamlattice" requiredextensions="b" '))
    with pytest.raises(InvalidFileError, match="beamlattice"):
        shapes.load(path)
    write(model.replace('objectid="1"/>', 'objectid="2"/>'))
    with pytest.raises(InvalidFileError) as error:
        shapes.load(path)
    assert error.value.path == path


@pytest.mark.parametrize(("axis", "extents"), [("Y", (40, 120, 50)), ("X", (50, 120, 40))])
def test_unit_and_axis_of_collada_are_used(axis: str, extents: tuple, tmp_path: Path) -> None:
    path = tmp_path / "a.dae"
    mesh = trimesh.creation.box((40, 50, 120))
    _dae(path, mesh.vertices, mesh.faces.tolist())
    text = path.read_text().replace('meter="1"', 'meter="0.001"').replace("Z_UP", f"{axis}_UP")
    path.write_text(text)
    shape = shapes.load(path)
    np.testing.assert_allclose(1e3 * shape.mesh.extents, extents)
    assert len(shape.repairs) == 2
    # Of a hand the unit is used, and the axis ignored, as RViz does.
    np.testing.assert_allclose(load_link_mesh(path, None).extents, (0.04, 0.05, 0.12))


@pytest.mark.parametrize("kind", ["tristrips", "trifans"])
def test_parts_of_collada_that_are_not_read_are_named(kind: str, tmp_path: Path) -> None:
    path = tmp_path / "a.dae"
    _dae(path, _block().vertices, _block().faces.tolist())
    path.write_text(path.read_text().replace("</mesh>", f"<{kind} count='0'/></mesh>"))
    with pytest.raises(InvalidFileError, match=kind):
        shapes.load(path)


def test_a_file_in_a_stated_unit_of_another_size_is_refused_without_advice_on_units(
    tmp_path: Path,
) -> None:
    _block().export(tmp_path / "a.3mf")  # metres, written as millimetres
    with pytest.raises(InvalidMeshError, match="states this unit"):
        shapes.load(tmp_path / "a.3mf")


@pytest.mark.parametrize(
    ("change", "said"),
    [
        ({"extensionsRequired": ["KHR_draco_mesh_compression"]}, "needs KHR_draco"),
        ({"extensionsRequired": ["EXT_meshopt_compression"]}, "needs EXT_meshopt"),
        ({"extensionsRequired": ["KHR_materials_unlit"]}, ""),
        ({"mode": 6}, "triangle fans"),
        ({"sparse": {"count": 1}}, "sparse accessors"),
    ],
)
def test_a_gltf_that_is_not_read_as_a_whole_is_refused(
    change: dict, said: str, tmp_path: Path
) -> None:
    content = _block().export(file_type="glb")
    length = struct.unpack_from("<I", content, 12)[0]
    header = json.loads(content[20 : 20 + length])
    if "mode" in change:
        header["meshes"][0]["primitives"][0] |= change
    elif "sparse" in change:
        header["accessors"][0] |= change
    else:
        header |= change
    text = json.dumps(header).encode()
    text += b" " * (-len(text) % 4)
    rest = content[20 + length :]
    start = struct.pack("<4sIIII", b"glTF", 2, 20 + len(text) + len(rest), len(text), 0x4E4F534A)
    (tmp_path / "a.glb").write_bytes(start + text + rest)
    if not said:
        assert shapes.load(tmp_path / "a.glb").mesh.is_watertight
        return
    with pytest.raises(InvalidFileError, match=said):
        shapes.load(tmp_path / "a.glb")


# ---------------------------------------------------------------- what it is instead


@pytest.mark.parametrize(
    ("name", "content", "said"),
    [
        ("a.stl", b"<!DOCTYPE html><html><body>Sign in</body></html>", "a web page"),
        ("a.obj", b'\n<html lang="en">', "a web page"),
        ("a.stl", b"; made by a slicer\nG28 ; home\nG1 X0 Y0\n", "G-code"),
        ("a.ply", b"version https://git-lfs.github.com/spec/v1\noid sha256:00\n", "git lfs pull"),
        ("a.obj", b"solid a\n facet normal 0 0 1\n outer loop\n", "an STL file: name it .stl"),
        ("a.stl", b"PK\x03\x04" + bytes(90), "a ZIP archive"),
        ("a.stl", b"ISO-10303-21;\nHEADER;\n", "a STEP file"),
        ("a.dae", b"<?xml version='1.0'?>\n<!-- hand --><mujoco model='a'/>", "MJCF"),
        ("a.obj", "v 0.1 0 0\n".encode("utf-16"), "UTF-16"),
        ("a.obj", b"v 0,1 0,2 0,3\nv 0,1 0 0\nv 0 0 0\nf 1 2 3\n", "decimal commas"),
        ("a.off", b"OFF\n3 1 0\n0,1 0 0\n0 0,1 0\n0 0 0\n3 0 1 2\n", "decimal commas"),
        ("a.off", b"OFF\n3 2 0\n0.1 0 0\n0 0.1 0\n0 0 0\n3 0 1 2\n", "3 vertices and 2 faces"),
        (
            "a.ply",
            b"ply\nformat ascii 1.0\nelement vertex 1\nproperty float x\nproperty float y\n"
            b"property float z\nelement tristrips 1\nproperty list int int vertex_indices\n"
            b"end_header\n0 0 0\n1 0\n",
            "triangle strips",
        ),
        ("a.step", b"ISO-10303-21;", "a CAD program such as FreeCAD"),
        ("a.fbx", b"Kaydara", "Blender"),
        ("a.wrl", b"#VRML V2.0", "MeshLab"),
        ("a.stl.zip", b"PK", "unpack it"),
    ],
)
def test_other_content_is_named_with_what_to_do(
    name: str, content: bytes, said: str, tmp_path: Path
) -> None:
    path = tmp_path / name
    path.write_bytes(content)
    with pytest.raises(InvalidFileError, match=said) as error:
        shapes.load(path)
    assert error.value.path == path
