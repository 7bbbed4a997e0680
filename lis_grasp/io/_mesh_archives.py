"""Meshes in 3MF files, and what COLLADA and glTF files state of units, axes and extensions."""

from __future__ import annotations

import re
import zipfile
from collections.abc import Mapping
from pathlib import Path
from typing import NamedTuple
from xml.etree.ElementTree import Element, tostring

import numpy as np
from defusedxml import DefusedXmlException, ElementTree

from lis_grasp.geometry import apply_pose, make_pose
from lis_grasp.io._polygons import triangulate
from lis_grasp.io.limits import MOST_ELEMENTS, require_small_archive
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
_DEEPEST = 100  # components inside of components
_LEAST_OF_POLYGONS = 3


class Stated(NamedTuple):
    """What a format or a file states: its unit [m] and the axis that points up, or None."""

    metres: float | None = None
    up: str | None = None


def read_3mf(path: Path) -> tuple[FloatArray, IntArray, Stated]:
    """Return the vertices and triangles of all items of a 3MF file, placed, and what it states.

    Raises
    ------
    ValueError
        If it needs an extension beyond materials and production, has no items, or a component is
        inside of itself.
    """
    with path.open("rb") as file, zipfile.ZipFile(file) as archive:
        require_small_archive(archive.infolist())
        if "_rels/.rels" not in archive.namelist():
            raise ValueError("it is an archive without a model")
        links = _parsed(archive.read("_rels/.rels"))
        start = next(r.attrib["Target"] for r in links if r.get("Type", "").endswith("/3dmodel"))
        models: dict[str, tuple[Element, dict[str, Element]]] = {}

        def model(name: str) -> tuple[Element, dict[str, Element]]:
            name = name.lstrip("/")
            if name not in models:
                text = archive.read(name)
                root = _parsed(text)
                _require_read(root, text)
                objects = {each.get("id", ""): each for each in root.iter() if _is(each, "object")}
                models[name] = root, objects
            return models[name]

        root, _ = model(start)
        placed: list[tuple[FloatArray, IntArray]] = []
        stack = [(start, item, np.eye(4), 0) for item in root.iter() if _is(item, "item")]
        if not stack:
            raise ValueError("it has no items to build")
        size = 0
        while stack:
            part, use, X, depth = stack.pop()
            part = next((v for k, v in use.attrib.items() if k.endswith("}path")), part)
            X = X @ _transform(use.get("transform"))
            body = model(part)[1][use.get("objectid", "")]
            meshes = [_mesh(each) for each in body if _is(each, "mesh")]
            placed += [(apply_pose(X, v), f) for v, f in meshes]
            size += 1 + sum(len(v) + len(f) for v, f in meshes)
            if depth > _DEEPEST or size > MOST_ELEMENTS:
                raise ValueError(f"it has components inside of themselves, or over {MOST_ELEMENTS}")
            inner = [each for each in body.iter() if _is(each, "component")]
            stack += [(part, each, X, depth + 1) for each in inner]
    starts = np.cumsum([0, *(len(vertices) for vertices, _ in placed)])
    faces = [f + start for (_, f), start in zip(placed, starts[:-1], strict=True)]
    stated = Stated(_UNITS_3MF[root.get("unit", "millimeter")], "z")
    return np.concatenate([v for v, _ in placed]), np.concatenate(faces), stated


def _parsed(text: bytes) -> Element:
    """Return the root of an XML text; ValueError if it declares entities."""
    try:
        root: Element = ElementTree.fromstring(text)
    except DefusedXmlException:
        raise ValueError("it declares entities, which are not read") from None
    return root


def _space(root: Element) -> str:
    """Return the namespace of an element, in braces."""
    return str(root.tag).rpartition("}")[0] + "}" if "}" in str(root.tag) else ""


def _is(element: Element, name: str) -> bool:
    return str(element.tag).rpartition("}")[2] == name


def _require_read(root: Element, text: bytes) -> None:
    """Raise ValueError if a 3MF model requires an extension that is not read."""
    names = dict(re.findall(rb'xmlns:(\w+)="([^"]*)"', text[: _DEEPEST**2]))
    for prefix in root.get("requiredextensions", "").split():
        namespace = names.get(prefix.encode(), prefix.encode()).decode("utf-8", "replace")
        if not _READ_3MF.search(namespace):
            raise ValueError(f"it requires the extension {namespace}, which is not read")


def _transform(text: str | None) -> FloatArray:
    """Return the transform (4, 4) of 12 numbers, which are of row vectors, row by row."""
    if text is None:
        return np.eye(4)
    rows = np.array(text.split(), dtype=np.float64).reshape(4, 3)
    return make_pose(rows[:3].T, rows[3])


def _mesh(element: Element) -> tuple[FloatArray, IntArray]:
    rows = [each for each in element.iter() if _is(each, "vertex")]
    vertices = np.array([[float(each.attrib[axis]) for axis in "xyz"] for each in rows])
    corners = [each for each in element.iter() if _is(each, "triangle")]
    faces = np.array([[int(each.attrib[v]) for v in ("v1", "v2", "v3")] for each in corners])
    faces = faces.astype(np.int64).reshape(-1, 3)
    if len(faces) and not 0 <= faces.min() <= faces.max() < len(rows):
        raise ValueError("a triangle names a vertex that it lacks")
    return vertices.reshape(-1, 3), faces


def plain_dae(content: bytes) -> tuple[bytes, Stated]:
    """Return a COLLADA text whose polygons are triangles, and what it states.

    Raises ValueError if it has polygons with holes, or whose outline crosses itself.
    """
    root = _parsed(content)
    if root.find(f"{_space(root)}scene") is None:
        raise ValueError("it has no scene")
    space = _space(root)
    unit, up = root.find(f"{space}asset/{space}unit"), root.find(f"{space}asset/{space}up_axis")
    metres = None if unit is None else float(unit.get("meter", "1"))
    axis = (up.text or "").strip()[:1].lower() if up is not None else None
    changed = [_cut_polygons(mesh, space) for mesh in root.iter(f"{space}mesh")]
    return tostring(root) if any(changed) else content, Stated(metres, axis or None)


def _cut_polygons(mesh: Element, space: str) -> bool:
    """Replace the polygons of a COLLADA mesh by triangles; return whether there were any."""
    changed = False
    for part in list(mesh):
        kind = str(part.tag).removeprefix(space)
        if kind not in ("polylist", "polygons"):
            continue
        if part.find(f"{space}ph") is not None:
            raise ValueError("it has polygons with holes: triangulate them where they were made")
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
        if max(lengths, default=0) <= _LEAST_OF_POLYGONS:
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
