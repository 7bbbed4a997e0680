"""Mesh files: damaged ones of every format, and glTF that announces more than there is."""

import json
import struct
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import trimesh

from lis_grasp.exceptions import InvalidFileError
from lis_grasp.io.mesh_files import read_mesh
from lis_grasp.robots.link_bodies import load_link_mesh
from lis_grasp.shapes import FORMATS, load


def _gltf(**changes: Any) -> dict[str, Any]:
    """Return a triangle as glTF, whose positions are in an embedded buffer."""
    return {
        "asset": {"version": "2.0"},
        "scene": 0,
        "scenes": [{"nodes": [0]}],
        "nodes": [{"mesh": 0}],
        "meshes": [{"primitives": [{"attributes": {"POSITION": 0}, "mode": 4}]}],
        "accessors": [{"bufferView": 0, "componentType": 5126, "count": 3, "type": "VEC3"}],
        "bufferViews": [{"buffer": 0, "byteLength": 36}],
        "buffers": [{"byteLength": 36, "uri": "data:;base64," + "A" * 48}],
    } | changes


def _refused(path: Path, content: bytes, reason: str) -> None:
    path.write_bytes(content)
    for read in (lambda: load_link_mesh(path, None), lambda: read_mesh(path, FORMATS)):
        with pytest.raises(InvalidFileError, match=reason):
            read()


def test_the_triangle_itself_is_read(tmp_path: Path) -> None:
    path = tmp_path / "a.gltf"
    path.write_text(json.dumps(_gltf()))
    assert read_mesh(path, FORMATS).mesh.faces.shape == (1, 3)


_EMPTY = {"componentType": 5126, "type": "VEC3"}
# Each node has the next one as its child twice: 2^40 in all.
_DOUBLED = [{"children": [n + 1, n + 1]} for n in range(40)] + [{"mesh": 0}]


@pytest.mark.parametrize(
    "changes",
    [
        {"accessors": [{"count": 60_000_000_000} | _EMPTY]},
        {"accessors": [{"count": -3} | _EMPTY]},
        {"accessors": [{"count": "6"} | _EMPTY]},
        {"nodes": [{"children": [7]}]},
        {"nodes": 5},
        {"buffers": [{"byteLength": 36, "uri": "/dev/zero"}]},
        {"buffers": [{"byteLength": 36, "uri": "absent.bin"}]},
        {"bufferViews": [{"buffer": 0, "byteLength": 99}]},
    ],
)
def test_a_gltf_beyond_its_file_is_refused(tmp_path: Path, changes: dict[str, Any]) -> None:
    _refused(tmp_path / "a.gltf", json.dumps(_gltf(**changes)).encode(), "a.gltf|zero|absent.bin")


@pytest.mark.parametrize("nodes", [_DOUBLED, [{"children": [0]}]])
def test_nodes_that_are_used_again_are_read_once(tmp_path: Path, nodes: list[Any]) -> None:
    (tmp_path / "a.gltf").write_text(json.dumps(_gltf(nodes=nodes)))
    assert len(read_mesh(tmp_path / "a.gltf", FORMATS).mesh.faces) <= 1


def _glb(header: object) -> bytes:
    text = json.dumps(header).encode()
    start = struct.pack("<4sIII4s", b"glTF", 2, 20 + len(text), len(text), b"JSON")
    return start + text


@pytest.mark.parametrize(
    ("name", "content"),
    [
        ("a.gltf", b"[]"),
        ("a.gltf", b"[" * 100_000),
        ("a.glb", _glb([])),
        ("a.glb", b"glTF"),
        ("a.stl", b""),
        ("a.obj", b"v 1 2 3\nf 1 1 99999999\n"),
        ("a.off", b"OFF\n1000000000 1000000000 0\n0 0 0\n"),
    ],
)
def test_a_damaged_mesh_is_one_sentence(tmp_path: Path, name: str, content: bytes) -> None:
    _refused(tmp_path / name, content, "a[.]")


@pytest.mark.parametrize("content", [b"", b"<x>", b"<COLLADA/>", b"\xff\x00"])
def test_a_damaged_dae_of_a_hand_is_one_sentence(tmp_path: Path, content: bytes) -> None:
    path = tmp_path / "a.dae"
    path.write_bytes(content)
    with pytest.raises(InvalidFileError) as error:
        load_link_mesh(path, None)
    assert error.value.path == path


@pytest.mark.parametrize("ending", ["step", "zae", "vtk", "json"])
@pytest.mark.parametrize("read", [lambda path: load_link_mesh(path, None), load])
def test_other_formats_are_refused_by_their_names(
    tmp_path: Path, ending: str, read: Callable[[Path], object]
) -> None:
    path = tmp_path / f"a.{ending}"
    path.write_bytes(b"PK\x03\x04")
    with pytest.raises(InvalidFileError, match="must end in one of .obj"):
        read(path)


@pytest.mark.parametrize("ending", ["stl", "obj", "ply", "glb", "gltf", "off", "dae"])
def test_bodies_of_hands_are_read_in_each_format(tmp_path: Path, ending: str) -> None:
    box = trimesh.creation.box(extents=(0.01, 0.02, 0.03))
    path = tmp_path / f"body.{ending}"
    if ending == "gltf":  # header and buffer
        for name, content in trimesh.exchange.gltf.export_gltf(trimesh.Scene(box)).items():
            (tmp_path / name).write_bytes(content)
        path = tmp_path / "model.gltf"
    else:
        box.export(path)
    # glTF has y upwards, and z points backwards.
    upright = (0.01, 0.03, 0.02) if ending.startswith("gl") else (0.01, 0.02, 0.03)
    np.testing.assert_allclose(load_link_mesh(path, None).extents, upright, atol=1e-9)
