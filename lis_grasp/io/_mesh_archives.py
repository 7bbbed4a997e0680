"""Meshes in 3MF files, and COLLADA with its polygons as triangles."""

from __future__ import annotations

import re
import zipfile
from collections.abc import Mapping
from functools import cache
from pathlib import Path
from xml.etree.ElementTree import Element, tostring

import numpy as np
from defusedxml import DefusedXmlException, ElementTree

from lis_grasp.geometry import apply_pose, make_pose
from lis_grasp.io._mesh_text import triangulate
from lis_grasp.io._slicer_parts import SlicerParts, left_out
from lis_grasp.io.limits import ReadError, reason_of, require_small
from lis_grasp.typing import FloatArray, IntArray

_UNITS_3MF: Mapping[str, float] = {
    "micron": 1e-6,
    "millimeter": 1e-3,
    "centimeter": 1e-2,
    "meter": 1.0,
    "inch": 0.0254,
    "foot": 0.3048,
}
_READ_3MF = re.compile(r"production|material|trianglesets")  # namespaces of extensions
_MOST_USES = 10_000  # of objects, wherever components use them
_START = 10_000  # bytes in which a model names its extensions

_Meshes = list[tuple[FloatArray, IntArray]]


def read_3mf(path: Path) -> tuple[FloatArray, IntArray, float, tuple[str, ...]]:
    """Return all printed items of a 3MF file at their places, without a slicer's helpers.

    They are vertices (V, 3) and faces (F, 3), the length of the file's unit [m], and in words what
    is not part of the model.

    Raises `ValueError` if it needs an extension beyond materials and production, has no items, or
    has a component inside of itself or a part to subtract.
    """
    with path.open("rb") as file, zipfile.ZipFile(file) as archive:
        require_small(sum(member.file_size for member in archive.infolist()))
        if "_rels/.rels" not in archive.namelist():
            raise ReadError("it is an archive without a model")
        links = _parsed(archive.read("_rels/.rels"))
        start = next(r.attrib["Target"] for r in links if r.get("Type", "").endswith("/3dmodel"))

        @cache
        def model(name: str) -> tuple[Element, dict[str, Element]]:
            text = archive.read(name.lstrip("/"))
            root = _parsed(text)
            _require_read(root, text[:_START])
            return root, {e.get("id", ""): e for e in root.iter() if _is(e, "object")}

        @cache
        def meshes_of(name: str, number: str) -> _Meshes:
            return _meshes(model(name)[1][number])

        root, _ = model(start)
        slicer = SlicerParts(archive, _parsed)
        placed: _Meshes = []
        others: list[str] = []
        size = 0
        uses = [(start, "", item, np.eye(4)) for item in root.iter() if _is(item, "item")]
        if not uses:
            raise ReadError("it has no items to build")
        for part, owner, use, X in uses:  # components are added as they are found
            part = next((v for k, v in use.attrib.items() if k.endswith("}path")), part)
            X = X @ _transform(use.get("transform"))
            if (number := use.get("objectid", "")) not in model(part)[1]:
                raise ReadError(f"an item is of the object {number}, which it lacks")
            element = model(part)[1][number]
            kind = slicer.kind(owner, number, element)
            if use.get("printable") == "0":
                kind = "not to be printed"
            if kind:
                others.append(kind)
                continue
            meshes = meshes_of(part, number)
            for vertices, corners in meshes:
                printed, kinds = slicer.printed(number, len(corners))
                others += kinds
                placed.append((apply_pose(X, vertices), corners[printed]))
            components = (each for each in element.iter() if _is(each, "component"))
            uses += [(part, number, component, X) for component in components]
            size += sum(vertices.nbytes + corners.nbytes for vertices, corners in meshes)
            require_small(size)
            if len(uses) > _MOST_USES:
                raise ReadError(f"it has components inside of themselves, or over {_MOST_USES}")
    if not placed and others:
        raise ReadError(f"all that it has is no matter: {others[0]}", "mark the object as printed")
    starts = np.cumsum([0, *(len(vertices) for vertices, _ in placed)])
    faces = [f + start for (_, f), start in zip(placed, starts[:-1], strict=True)]
    unit = root.get("unit", "millimeter")
    if unit not in _UNITS_3MF:
        raise ReadError(f"it states the unit {unit}, which 3MF does not have")
    vertices = np.concatenate([v for v, _ in placed])
    return vertices, np.concatenate(faces), _UNITS_3MF[unit], left_out(others)


def _parsed(text: bytes) -> Element:
    """Return the root of an XML text; ValueError if it declares entities."""
    try:
        root: Element = ElementTree.fromstring(text)
    except DefusedXmlException:
        raise ReadError("it declares entities, which are not read") from None
    except ElementTree.ParseError as error:
        raise ReadError(reason_of(error, "XML")) from None
    return root


def _is(element: Element, name: str) -> bool:
    return str(element.tag).rpartition("}")[2] == name


def _require_read(root: Element, start: bytes) -> None:
    """Raise ValueError if a 3MF model requires an extension that is not read."""
    names = dict(re.findall(rb'xmlns:(\w+)="([^"]*)"', start))
    for prefix in root.get("requiredextensions", "").split():
        namespace = names.get(prefix.encode(), prefix.encode()).decode("utf-8", "replace")
        if not _READ_3MF.search(namespace):
            raise ReadError(f"it requires the extension {namespace}, which is not read")


def _transform(text: str | None) -> FloatArray:
    """Return the transform (4, 4) of 12 numbers, given row by row for row vectors."""
    if text is None:
        return np.eye(4)
    rows = np.array(text.split(), dtype=np.float64).reshape(4, 3)
    return make_pose(rows[:3].T, rows[3])


def _meshes(element: Element) -> _Meshes:
    """Return the vertices (V, 3) and faces (F, 3) of the mesh of an object, if it has one."""
    rows = [each for each in element.iter() if _is(each, "vertex")]
    corners = [each for each in element.iter() if _is(each, "triangle")]
    vertices = np.array([[each.attrib[axis] for axis in "xyz"] for each in rows], np.float64)
    faces = np.array([[each.attrib[v] for v in ("v1", "v2", "v3")] for each in corners], np.int64)
    if len(faces) and not 0 <= faces.min() <= faces.max() < len(rows):
        raise ReadError("a triangle names a vertex that it lacks")
    return [(vertices, faces)] if len(faces) else []


def plain_dae(content: bytes) -> tuple[bytes, float | None, str | None]:
    """Return a COLLADA text whose polygons are triangles, its unit [m], and its upward axis.

    Raises ValueError if it has polygons with holes, or whose outline crosses itself.
    """
    root = _parsed(content)
    space = str(root.tag).rpartition("}")[0] + "}" if "}" in str(root.tag) else ""
    if root.find(f"{space}scene") is None:
        raise ReadError("it has no scene")
    for kind in ("tristrips", "trifans", "instance_controller"):
        if next(root.iter(space + kind), None) is not None:
            raise ReadError(f"it has {kind}, which are not read", "export plain triangles")
    for array in root.iter(f"{space}float_array"):
        held = len(np.array((array.text or "").split(), np.float64))
        if held != int(array.get("count", held)):
            raise ReadError(f"it announces {array.get('count')} numbers, and has {held}")
    unit, up = root.find(f"{space}asset/{space}unit"), root.find(f"{space}asset/{space}up_axis")
    metres = None if unit is None else float(unit.get("meter", "1"))
    axis = (up.text or "").strip()[:1].lower() if up is not None else None
    changed = [_cut_polygons(mesh, space) for mesh in root.iter(f"{space}mesh")]
    return tostring(root) if any(changed) else content, metres, axis or None


def _cut_polygons(mesh: Element, space: str) -> bool:
    """Replace the polygons of a COLLADA mesh by triangles; return whether there were any."""
    changed = False
    for part in list(mesh):
        kind = str(part.tag).removeprefix(space)
        if kind not in ("polylist", "polygons"):
            continue
        if part.find(f"{space}ph") is not None:
            raise ReadError("it has polygons with holes", "triangulate them where they were made")
        inputs = [each for each in part if _is(each, "input")]
        width = 1 + max(int(each.get("offset", "0")) for each in inputs)
        rows = np.array(
            " ".join(p.text or "" for p in part.iter(f"{space}p")).split(), dtype=np.int64
        ).reshape(-1, width)
        counts = part.find(f"{space}vcount")
        lengths = (
            [len((p.text or "").split()) // width for p in part.iter(f"{space}p")]
            if counts is None
            else [int(word) for word in (counts.text or "").split()]
        )
        if max(lengths, default=0) <= 3:
            continue
        changed = True
        column = next(int(e.get("offset", "0")) for e in inputs if e.get("semantic") == "VERTEX")
        corners = np.split(rows, np.cumsum(lengths)[:-1])
        cut = triangulate(_positions(mesh, space), [c[:, column].tolist() for c in corners])
        made = [c[t.ravel()].ravel() for c, t in zip(corners, cut, strict=True)]
        for child in list(part):
            if not _is(child, "input"):
                part.remove(child)
        part.tag = f"{space}triangles"
        part.set("count", str(sum(len(t) for t in cut)))
        text = Element(f"{space}p")
        text.text = " ".join(map(str, np.concatenate(made)))
        part.append(text)
    return changed


def _positions(mesh: Element, space: str) -> FloatArray:
    """Return the positions of a COLLADA mesh, (V, 3)."""
    uses = mesh.iterfind(f"{space}vertices/{space}input")
    name = next(use.get("source", "")[1:] for use in uses if use.get("semantic") == "POSITION")
    source = next(each for each in mesh.iter(f"{space}source") if each.get("id") == name)
    numbers = source.find(f"{space}float_array")
    assert numbers is not None
    return np.array((numbers.text or "").split(), dtype=np.float64).reshape(-1, 3)
