"""What a file is by its content, where its name promises something else."""

from __future__ import annotations

import re
from pathlib import Path

_START = 4096  # bytes that tell
_KINDS = (
    (rb"version https://git-lfs", "the pointer of Git LFS to a file: run `git lfs pull` beside it"),
    (rb"\s*<(!doctype html|html)", "a web page, as of a failed download: download the file itself"),
    (rb"\x1f\x8b|BZh|\xfd7zXZ|7z\xbc\xaf|Rar!", "compressed: unpack it"),
    (rb"PK\x03\x04", "a ZIP archive: unpack it"),
    (rb"\xff\xfe|\xfe\xff", "UTF-16 text: save it as UTF-8"),
    (rb"ISO-10303-21", "a STEP file: export it as STL from a CAD program such as FreeCAD"),
    (rb"glTF", "a binary glTF: name it .glb"),
    (rb"ply\s", "a PLY file: name it .ply"),
    (rb"(ST)?C?N?OFF\s", "an OFF file: name it .off"),
    (rb"solid\b[^\0]*\sfacet\s", "an STL file: name it .stl"),
    (rb"# \.PCD|VERSION \.?\d", "a point cloud of PCL: name it .pcd"),
    (rb"\x93NUMPY", "an array of NumPy: name it .npy"),
    (rb"<COLLADA\b", "a COLLADA file: name it .dae"),
    (rb"<mujoco\b", "an MJCF model of MuJoCo, not a mesh"),
    (rb"<(robot|sdf)\b", "the description of a robot, not a mesh"),
    (rb"[GM]\d+(\s|$)", "G-code of a slicer: take the mesh that it was made from"),
)
# What precedes the first line that tells: a byte order mark, comments, the start of XML.
_BEFORE = re.compile(rb"\s+|\xef\xbb\xbf|<!--.*?-->|<\?.*?\?>|[;#(%][^\n]*\n", re.DOTALL)
_DECIMAL_COMMA = re.compile(rb"^\s*[a-z ]*[-+]?\d+,\d+\s", re.MULTILINE | re.IGNORECASE)


def kind_of(path: Path, but: str = "") -> str:
    """Return what a file is, with what to do; empty if that is unknown, or has the ending `but`."""
    with path.open("rb") as file:
        start = file.read(_START)
    begin = 0
    while found := _BEFORE.match(start, begin):
        begin = found.end()
    for pattern, kind in _KINDS:
        expression = re.compile(pattern, re.IGNORECASE)
        found = expression.match(start) or expression.match(start, begin)
        if found and not kind.endswith(f" {but}"):
            return kind
    if b"\0" not in start and _DECIMAL_COMMA.search(start):
        return "text with decimal commas: write numbers with a decimal point"
    return ""
