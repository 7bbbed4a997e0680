"""Meshes in OBJ, OFF, STL and PLY files: what trimesh does not read, or reads wrongly."""

from __future__ import annotations

import re
import struct
from collections import defaultdict
from collections.abc import Sequence
from pathlib import Path

import manifold3d
import numpy as np

from lis_grasp.exceptions import note
from lis_grasp.geometry import tangent_frame, unit
from lis_grasp.io._ply import polygons_of, read_ply
from lis_grasp.io.limits import ReadError
from lis_grasp.typing import FloatArray, IntArray

# Areas below this fraction of a polygon's are rounding.
_ROUNDING = 1e-6

# OBJ: a face line other than three corners, all v, v/vt, v//vn or v/vt/vn, with indices from the
# start of the file; a line that continues in the next; a separator other than blanks.
_OBJ_PLAIN = rb"f(?:(?: +N){3}|(?: +N/(?:N)?){3}|(?: +N//(?:N)?){3}|(?: +N/N/(?:N)?){3})".replace(
    b"N", rb"[1-9]\d*"
)
_OBJ_ODD = re.compile(
    rb"^(?=[ \t]*f[ \t])(?!" + _OBJ_PLAIN + rb" *\r?$)|\\[ \t]*\r?$|^[ \t]*v[nt]?\t", re.MULTILINE
)
_OBJ_WORDS = re.compile(
    rb"^[ \t]*v[ \t](?![-+.\deinaf \t]*(?:#.*|\\[ \t]*)?$).*", re.MULTILINE | re.IGNORECASE
)
_OBJ_FACE = re.compile(rb"^f ", re.MULTILINE)
_INTEGER = re.compile(r"[-+]?\d{1,18}")
_OFF_START = re.compile(r"(?:ST)?C?N?OFF\b", re.IGNORECASE)
_STL_NAME = re.compile(rb"^[ \t]*(?:end)?solid\b[^\r\n]*", re.IGNORECASE | re.MULTILINE)
_STL_VERTEX = re.compile(rb"\bvertex\s+(\S{1,40})\s+(\S{1,40})\s+(\S{1,40})(?!\S)", re.IGNORECASE)
_STL_EXPONENT = re.compile(rb"(\d)d([-+]?\d)", re.IGNORECASE)  # Fortran writes 1.0D-02
_STL_FACET = re.compile(rb"\bfacet\s+normal\b", re.IGNORECASE)
_STL_FACET_END = re.compile(rb"\bend\s*facet\b", re.IGNORECASE)
_STL_ROW = np.dtype([("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("attribute", "<u2")])
_STL_NAMED = 1000  # bytes within which a text has its first facet
_STL_START = 84  # bytes before the first triangle, the last four of them the count


def triangulate(vertices: FloatArray, polygons: Sequence[Sequence[int]]) -> list[IntArray]:
    """Return the triangles (K, 3) of each polygon, as numbers of its corners.

    A polygon whose fan about its first corner covers it gets that fan, as quads and convex ones do;
    others are cut in their plane, which keeps the outline and the area. Fewer than three corners
    give no triangles. Raises ValueError for a vertex that is missing, or an outline that crosses
    itself.
    """
    lengths = defaultdict(list)
    for number, polygon in enumerate(polygons):
        lengths[len(polygon)].append(number)
    triangles: list[IntArray] = [np.empty((0, 3), np.int64)] * len(polygons)
    for length, numbers in lengths.items():
        if length < 3:
            continue
        indices = np.array([polygons[n] for n in numbers], dtype=np.int64)  # (P, length)
        if indices.min() < 0 or indices.max() >= len(vertices):
            raise ReadError("a face names a vertex that it lacks")
        steps = np.arange(1, length - 1)
        fan = np.column_stack([np.zeros_like(steps), steps, steps + 1])
        corners = vertices[indices]
        spokes = corners[:, 1:] - corners[:, :1]  # (P, length - 1, 3)
        parts = np.cross(spokes[:, :-1], spokes[:, 1:])  # (P, length - 2, 3), twice the areas
        total = parts.sum(axis=1)  # Newell's normal
        areas = np.linalg.norm(total, axis=1)
        along = np.einsum("pki,pi->pk", parts, total)
        sizes = np.linalg.norm(parts, axis=2).sum(axis=1)
        covered = (along >= -_ROUNDING * areas[:, None] ** 2).all(axis=1)
        covered |= ~(areas > _ROUNDING * sizes)  # no plane
        for row, number in enumerate(numbers):
            triangles[number] = fan if covered[row] else _cut(corners[row], total[row])
    return triangles


def _cut(corners: FloatArray, normal: FloatArray) -> IntArray:
    """Return the triangles of a polygon (N, 3) in the plane of its Newell normal."""
    # (N, 2), counterclockwise
    flat = (corners - corners[0]) @ tangent_frame(unit(normal)).T
    scale = np.ptp(flat, axis=0).max()
    triangles = np.asarray(manifold3d.triangulate([flat / scale]), dtype=np.int64).reshape(-1, 3)
    sides = np.diff(flat[triangles], axis=1)  # (K, 2, 2)
    covered = np.abs(sides[:, 0, 0] * sides[:, 1, 1] - sides[:, 0, 1] * sides[:, 1, 0]).sum()
    if not abs(covered - np.linalg.norm(normal)) <= 1e3 * _ROUNDING * covered:
        raise ReadError(
            f"the outline of a face with {len(corners)} corners crosses itself, so that no"
            " triangles cover it"
        )
    return triangles


def as_triangles(vertices: FloatArray, polygons: Sequence[Sequence[int]]) -> IntArray:
    """Return all polygons as triangles (F, 3) of vertices; for errors see `triangulate`."""
    cut = triangulate(vertices, polygons)
    faces = [np.asarray(p)[t] for p, t in zip(polygons, cut, strict=True) if len(t)]
    return np.concatenate(faces).astype(np.int64) if faces else np.empty((0, 3), np.int64)


Triangles = tuple[FloatArray, IntArray]


def plain_obj(content: bytes) -> tuple[bytes, int]:
    """Return an OBJ as trimesh reads it without fault, and its number of faces.

    These are triangles, whose corners have one form and indices from the start of the file. A
    relative index counts from the vertex before its line, wherever the groups are. Raises
    ValueError if it is binary, a vertex is not of numbers, an index is out of range, or a face
    crosses itself.
    """
    if b"\0" in content:
        raise ReadError("it is binary, and OBJ is text")
    content = content.replace(b"\r\n", b"\n").replace(b"\r", b"\n")
    if odd := _OBJ_WORDS.search(content):
        line = odd[0].decode("utf-8", "replace").strip()[:60]
        raise ReadError(f"the line '{line}' is a vertex that is not of numbers")
    if _OBJ_ODD.search(content):
        content = _rewritten_obj(content)
    return content, len(_OBJ_FACE.findall(content))


def _rewritten_obj(content: bytes) -> bytes:
    text = re.sub(r"\\[ \t]*\r?\n", " ", content.decode("utf-8", "replace"))
    lines = text.splitlines()
    counts = {"v": 0, "vt": 0, "vn": 0}
    vertices: list[list[float]] = []
    faces: dict[int, list[str]] = {}  # by line
    for number, line in enumerate(lines):
        kind, *words = line.split("#")[0].split() or [""]
        if kind in counts:
            counts[kind] += 1
            lines[number] = " ".join([kind, *words])
        if kind == "v":
            vertices.append([float(word) for word in words[:3]])
        elif kind == "f":
            if len(words) < 3:
                raise ReadError(f"the face '{line.strip()}' has fewer than three corners")
            corners = [_absolute(corner, counts) for corner in words]
            of_one_form = len({tuple(map(bool, corner)) for corner in corners}) == 1
            faces[number] = ["/".join(c) if of_one_form else c[0] for c in corners]
    polygons = [[int(corner.split("/")[0]) - 1 for corner in face] for face in faces.values()]
    cut = triangulate(np.array(vertices, np.float64).reshape(-1, 3), polygons)
    for (number, face), triangles in zip(faces.items(), cut, strict=True):
        lines[number] = "\n".join(f"f {face[a]} {face[b]} {face[c]}" for a, b, c in triangles)
    return "\n".join(lines).encode()


def _absolute(corner: str, counts: dict[str, int]) -> list[str]:
    """Return the indices of a corner v/vt/vn from the start of the file; empty where missing."""
    indices = []
    for name, text in zip(counts, corner.split("/"), strict=False):
        if text and not _INTEGER.fullmatch(text):
            raise ReadError(f"a face has the corner {corner}, which is no index")
        index = int(text) if text else 0
        if index < 0:
            index += counts[name] + 1
            if index <= 0:
                raise ReadError(f"the face corner {corner} counts back beyond the first {name}")
        if text and index == 0 and name == "v":
            raise ReadError(
                f"the face corner {corner} has the index 0, and OBJ counts from 1",
                "add 1 to the indices of its faces",
            )
        indices.append(str(index) if index else "")
    return indices


def off_rows(path: Path) -> tuple[list[list[str]], list[list[str]]]:
    """Return the rows of an OFF file as words: those with vertices, and those with faces."""
    text = path.read_text(encoding="utf-8-sig", errors="replace")
    lines = [words for line in text.splitlines() if (words := line.split("#")[0].split())]
    if not lines or not _OFF_START.fullmatch(lines[0][0]) or "BINARY" in lines[0]:
        raise ReadError("it must begin with OFF, as text")
    lines = [words for words in (lines[0][1:], *lines[1:]) if words]
    if not lines:
        raise ReadError("it has no counts")
    vertices, faces = (int(word) for word in lines[0][:2])
    if min(vertices, faces) < 0 or len(lines) - 1 < vertices + faces:
        raise ReadError(
            f"it announces {vertices} vertices and {faces} faces, and has {len(lines) - 1} lines of"
            " them"
        )
    return lines[1 : 1 + vertices], lines[1 + vertices : 1 + vertices + faces]


def read_off(path: Path) -> tuple[FloatArray, list[list[int]]]:
    """Return the vertices (V, 3) and polygons of an OFF file; other columns are left out."""
    vertices, faces = off_rows(path)
    polygons = [[int(word) for word in row[1 : 1 + int(row[0])]] for row in faces]
    for polygon, row in zip(polygons, faces, strict=True):
        if len(polygon) != int(row[0]):
            raise ReadError(f"a face announces {row[0]} corners and has {len(polygon)}")
    if any(len(row) < 3 for row in vertices):
        raise ReadError("a vertex has fewer than three numbers")
    return np.array([row[:3] for row in vertices], np.float64).reshape(-1, 3), polygons


def read_stl(path: Path) -> Triangles:
    """Return the triangles of an STL file, text or binary, each with vertices of its own.

    A text that ends before its ``endsolid``, such as an incomplete download, is noted.
    """
    content = path.read_bytes()
    (count,) = struct.unpack_from("<I", content, _STL_START - 4) if len(content) >= 84 else (0,)
    held = (len(content) - _STL_START) // _STL_ROW.itemsize
    is_exact = len(content) == _STL_START + _STL_ROW.itemsize * count
    if not is_exact and (b"\0" not in content or _STL_FACET.search(content[:_STL_NAMED])):
        corners, is_ended = _corners_in_text(content)
        if not is_ended:
            note(f"{path} ends without 'endsolid': if a download stopped, repeat it")
    elif len(content) < _STL_START:
        raise ReadError(f"it has {len(content)} bytes, fewer than the start of a binary STL")
    elif count > held or (count == 0 and held > 0):
        raise ReadError(f"it announces {count} triangles, and has bytes for {max(held, 0)}")
    else:  # other programs write bytes after the last triangle
        rows = np.frombuffer(content, _STL_ROW, count, _STL_START)
        corners = rows["corners"].reshape(-1, 3).astype(np.float64)
    return corners, np.arange(len(corners)).reshape(-1, 3)


def _corners_in_text(content: bytes) -> tuple[FloatArray, bool]:
    """Return the corners (3 F, 3) of a text, and whether its last solid is complete."""
    names = [name[0].split()[0].lower() for name in _STL_NAME.finditer(content)]
    begins = _STL_NAME.search(content) is not None
    content = _STL_NAME.sub(b"", content)  # the name may have any words
    found = _STL_VERTEX.findall(_STL_EXPONENT.sub(rb"\1E\2", content))
    starts = [match.start() for match in _STL_FACET.finditer(content)]
    facets = len(starts)
    if not begins and not facets:
        raise ReadError("it is text without facets")
    if starts and _STL_FACET_END.search(content) and not _STL_FACET_END.search(content, starts[-1]):
        raise ReadError(f"it is cut off within facet {facets}")
    if len(found) != 3 * facets:
        raise ReadError(f"it has {facets} facets and {len(found)} vertices, not three for each")
    return np.array(found).astype(np.float64).reshape(-1, 3), names[-1:] == [b"endsolid"]


def read_ply_polygons(path: Path) -> Triangles:
    """Return the vertices and triangles of a PLY file with faces of any numbers of corners."""
    data = read_ply(path)
    elements = {element.name: element.data for element in data.elements}
    if "tristrips" in elements and "face" not in elements:
        raise ReadError("it has triangle strips and no faces", "write it with faces")
    if "vertex" not in elements:
        raise ReadError("it has no vertices")
    vertices = np.column_stack([elements["vertex"][axis].astype(np.float64) for axis in "xyz"])
    return vertices, as_triangles(vertices, [list(map(int, row)) for row in polygons_of(data)])
