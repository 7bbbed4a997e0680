"""Surface files: saved surfaces load unchanged, invalid ones are refused."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import trimesh

from lis_grasp.exceptions import InvalidFileError, InvalidMeshError
from lis_grasp.io import provenance
from lis_grasp.io.surface_files import load_surface, save_surface


@pytest.fixture
def mesh() -> trimesh.Trimesh:
    """A ball whose uncertainty grows downwards."""
    sphere = trimesh.creation.icosphere(subdivisions=2, radius=0.1)
    ball = trimesh.Trimesh(sphere.vertices / 3.0, sphere.faces, process=False)
    ball.vertex_attributes["uncertainty"] = ball.vertices[:, 2].max() - ball.vertices[:, 2]
    return ball


def test_a_saved_surface_loads_unchanged(mesh: trimesh.Trimesh, tmp_path: Path) -> None:
    path = tmp_path / "surface.ply"
    save_surface(mesh, path)
    back = load_surface(path)
    np.testing.assert_array_equal(back.vertices, mesh.vertices)
    np.testing.assert_array_equal(back.faces, mesh.faces)
    np.testing.assert_array_equal(
        back.vertex_attributes["uncertainty"], mesh.vertex_attributes["uncertainty"]
    )
    assert back.is_watertight


def test_a_copy_of_a_surface_has_equal_bytes(mesh: trimesh.Trimesh, tmp_path: Path) -> None:
    first, second = tmp_path / "a.ply", tmp_path / "b.ply"
    save_surface(mesh, first, header="seed 1")
    back = load_surface(first)
    save_surface(back, second, header=back.metadata["header"])
    assert first.read_bytes() == second.read_bytes()


def test_the_header_keeps_the_provenance(mesh: trimesh.Trimesh, tmp_path: Path) -> None:
    path = tmp_path / "surface.ply"
    save_surface(mesh, path, header=provenance.describe(object="box", seed=3))
    assert provenance.read(path)["seed"] == 3
    assert provenance.parse(load_surface(path).metadata["header"])["object"] == "box"


def test_a_header_of_several_lines_and_any_characters_is_kept(
    mesh: trimesh.Trimesh, tmp_path: Path
) -> None:
    path = tmp_path / "surface.ply"
    save_surface(mesh, path, header="one\n\ntwo µm\n")
    assert load_surface(path).metadata["header"] == "one\ntwo \\xb5m"


def test_other_programs_read_the_same_surface_in_colours(
    mesh: trimesh.Trimesh, tmp_path: Path
) -> None:
    path = tmp_path / "surface.ply"
    save_surface(mesh, path)
    seen = trimesh.load(path, process=False)
    np.testing.assert_array_equal(seen.faces, mesh.faces)
    np.testing.assert_allclose(seen.vertices, mesh.vertices)
    colours = seen.visual.vertex_colors[:, :3].astype(int)
    best = np.argmin(mesh.vertex_attributes["uncertainty"])
    worst = np.argmax(mesh.vertex_attributes["uncertainty"])
    np.testing.assert_array_equal(colours[best], [38, 130, 142])  # teal
    np.testing.assert_array_equal(colours[worst], [253, 231, 37])  # yellow


def test_a_surface_without_uncertainty_loads_without(mesh: trimesh.Trimesh, tmp_path: Path) -> None:
    path = tmp_path / "surface.ply"
    del mesh.vertex_attributes["uncertainty"]
    save_surface(mesh, path)
    assert "uncertainty" not in load_surface(path).vertex_attributes


@pytest.mark.parametrize("value", [0.0, 0.01, np.inf])
def test_any_uncertainty_has_a_colour(value: float, mesh: trimesh.Trimesh, tmp_path: Path) -> None:
    path = tmp_path / "surface.ply"
    mesh.vertex_attributes["uncertainty"] = np.full(len(mesh.vertices), value)
    save_surface(mesh, path)
    assert (load_surface(path).vertex_attributes["uncertainty"] == value).all()


def test_a_text_file_of_another_program_is_read(tmp_path: Path) -> None:
    path = tmp_path / "surface.ply"
    path.write_text(
        "ply\nformat ascii 1.0\nelement vertex 4\nproperty float z\nproperty float x\n"
        "property float y\nelement face 4\nproperty list uchar uint vertex_index\nend_header\n"
        "0 0 0\n0 1 0\n0 0 1\n1 0 0\n3 0 2 1\n3 0 1 3\n3 0 3 2\n3 1 2 3\n"
    )
    mesh = load_surface(path)
    assert mesh.volume == pytest.approx(1.0 / 6.0)


def _ply(vertices: str, faces: str) -> str:
    return (
        f"ply\nformat ascii 1.0\nelement vertex {vertices.count(chr(10))}\n"
        "property double x\nproperty double y\nproperty double z\n"
        f"element face {faces.count(chr(10))}\nproperty list uchar int vertex_indices\n"
        f"end_header\n{vertices}{faces}"
    )


@pytest.mark.parametrize(
    "content",
    [
        "solid",
        _ply("0 0 0\n1 0 0\n0 1 0\n", "3 0 1 2\n")[:-12],
        _ply("0 0 0\n", "").replace("vertex 1", "vertex 99999999999999"),
        _ply("0 0 0 -1\n1 0 0 1\n0 1 0 1\n", "3 0 1 2\n").replace(
            "double z", "double z\nproperty double uncertainty"
        ),
        _ply("0 0 0\n1 0 0\n0 1 0\n", ""),
        _ply("0 0 0\n1 0 0\n0 1 0\n", "3 0 1 3\n"),
        _ply("0 0 0\n1 0 0\n0 1 0\n", "3 0 1 -1\n"),
        _ply("0 0 0\n1 0 0\n1 1 0\n0 1 0\n", "4 0 1 2 3\n"),
        _ply("0 0 0\n1 0 nan\n0 1 0\n", "3 0 1 2\n"),
        _ply("0 0 0\n1 0 0\n0 1 0\n", "3 0 1 2\n").replace("double z", "double w"),
    ],
    ids=[
        "not a PLY",
        "cut off",
        "too short",
        "negative uncertainty",
        "no faces",
        "index too large",
        "negative index",
        "quad",
        "nan",
        "no z",
    ],
)
def test_a_file_without_a_surface_is_refused(content: str, tmp_path: Path) -> None:
    path = tmp_path / "surface.ply"
    path.write_text(content)
    with pytest.raises(InvalidFileError) as error:
        load_surface(path)
    assert error.value.path == path


def test_another_ending_is_refused(mesh: trimesh.Trimesh, tmp_path: Path) -> None:
    with pytest.raises(InvalidFileError) as error:
        save_surface(mesh, tmp_path / "surface.stl")
    assert error.value.path == tmp_path / "surface.stl"
    with pytest.raises(InvalidFileError) as error:
        load_surface(tmp_path / "surface.stl")
    assert error.value.path == tmp_path / "surface.stl"


def test_a_folder_that_cannot_be_made_is_refused(mesh: trimesh.Trimesh, tmp_path: Path) -> None:
    (tmp_path / "nowhere").write_text("a file")
    with pytest.raises(InvalidFileError) as error:
        save_surface(mesh, tmp_path / "nowhere" / "surface.ply")
    assert error.value.path == tmp_path / "nowhere" / "surface.ply"


def test_an_invalid_mesh_is_not_written(mesh: trimesh.Trimesh, tmp_path: Path) -> None:
    path = tmp_path / "surface.ply"
    mesh.vertex_attributes["uncertainty"] = np.zeros(3)
    with pytest.raises(InvalidMeshError):
        save_surface(mesh, path)
    with pytest.raises(InvalidMeshError):
        save_surface(trimesh.Trimesh(np.zeros((3, 3)), process=False), path)
    with pytest.raises(InvalidMeshError):
        save_surface(trimesh.Trimesh(np.full((3, 3), np.nan), [[0, 1, 2]], process=False), path)
    assert not path.exists()


def test_a_ply_that_announces_more_rows_than_bytes_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "s.ply"
    lines = (
        "ply",
        "format ascii 1.0",
        "element vertex 2000000000",
        "property float x",
        "end_header",
    )
    path.write_text("\n".join(lines) + "\n0\n")
    with pytest.raises(InvalidFileError) as error:
        load_surface(path)
    assert error.value.path == path
