"""Kinds of files by their content, where the name promises another kind."""

from __future__ import annotations

import re
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from lis_grasp.exceptions import InvalidFileError

_START = 4096  # bytes that show the kind
_NO_MESH = ", not a mesh"
_KINDS = tuple(
    (re.compile(pattern, re.IGNORECASE), kind)
    for pattern, kind in (
        (
            rb"version https://git-lfs",
            "the pointer of Git LFS to a file: run `git lfs pull` beside it",
        ),
        (
            rb"\s*<(!doctype html|html)",
            "a web page, as of a failed download: download the file itself",
        ),
        (rb"\x1f\x8b|BZh|\xfd7zXZ|7z\xbc\xaf|Rar!", "compressed: unpack it"),
        (rb"PK\x03\x04", "a ZIP archive, as a workbook is too: unpack it, or export it"),
        (
            rb"\x89PNG|\xff\xd8\xff|%PDF|GIF8|RIFF",
            "an image or a document: take the file of the shape",
        ),
        (rb"\xff\xfe|\xfe\xff", "UTF-16 text: save it as UTF-8"),
        (rb"ISO-10303-21", "a STEP file: export it as STL from a CAD program such as FreeCAD"),
        (rb"glTF", "a binary glTF: name it .glb"),
        (rb"\{[^\0]*\"(asset|accessors|buffers)\"", "a glTF of text: name it .gltf"),
        (rb"(mtllib|v\s+[-+.\d]+)\s", "an OBJ file: name it .obj"),
        (rb"ply\s", "a PLY file: name it .ply"),
        (rb"(ST)?C?N?OFF\s", "an OFF file: name it .off"),
        (rb"solid\b[^\0]*\sfacet\s", "an STL file: name it .stl"),
        (rb"# \.PCD|VERSION \.?\d", "a point cloud of PCL: name it .pcd"),
        (rb"\x93NUMPY", "an array of NumPy: name it .npy"),
        (rb"<COLLADA\b", "a COLLADA file: name it .dae"),
        (rb"<mujoco\b", f"an MJCF model of MuJoCo{_NO_MESH}"),
        (rb"<(robot|sdf)\b", f"the description of a robot{_NO_MESH}"),
        (rb"#usda|PXR-USDC", "USD: export it in another format"),
        (rb"\Z", "empty: download or export it again"),
        (rb"[GM]\d+(\s|$)", "G-code of a slicer: take the mesh that it was made from"),
    )
)
# Text before the first line that shows the kind: a byte order mark, comments, the start of XML.
_BEFORE = re.compile(rb"\s+|\xef\xbb\xbf|<!--.*?-->|<\?.*?\?>|[;#(%][^\n]*\n", re.DOTALL)
_ARCHIVES = (".3mf", ".npz")
_WITH_POINTS = (".obj", ".stl", ".ply", ".off", ".pcd")  # texts in which no comma separates
_DECIMAL_COMMA = re.compile(rb"^\s*[a-z ]*[-+]?\d+,\d+\s", re.MULTILINE | re.IGNORECASE)


@contextmanager
def named_by_content(path: Path) -> Iterator[None]:
    """Say what a file is if its content is of another kind than its name says.

    An `InvalidFileError` in this context becomes one that names the kind, if it is known.
    """
    try:
        yield
    except InvalidFileError:
        require_kind(path)
        raise


def require_kind(path: Path, needed: str = "") -> None:
    """Raise `InvalidFileError` for a file of another known kind than its name says.

    `needed` names the required kind if the ending does not, such as a robot's description.
    """
    ending = path.suffix.lower()
    kind = _kind_of(path, ending) if path.is_file() else ""
    is_named = ending in _ARCHIVES and "ZIP" in kind
    if kind and not is_named and not (needed and kind.endswith(_NO_MESH)):
        needed = needed or ending[1:].upper()
        raise InvalidFileError(f"{path} must be {needed}; it is {kind}", path=path)


def _kind_of(path: Path, ending: str) -> str:
    """Return what a file is and what to do; empty if that is unknown, or as its ending says."""
    with path.open("rb") as file:
        start = file.read(_START)
    begin = 0
    while before := _BEFORE.match(start, begin):
        begin = before.end()
    for pattern, kind in _KINDS:
        found = pattern.match(start) or pattern.match(start, begin)
        if found and not kind.endswith(f" {ending}"):
            return kind
    if ending in _WITH_POINTS and b"\0" not in start and _DECIMAL_COMMA.search(start):
        return "text with decimal commas: write numbers with a decimal point"
    return ""
