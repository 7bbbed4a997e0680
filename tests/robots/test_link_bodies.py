"""Mesh files of links: upright in any format."""

from pathlib import Path

import numpy as np
import pytest
import trimesh

from lis_grasp.robots.link_bodies import load_mesh


@pytest.mark.parametrize("ending", ["obj", "stl", "ply", "glb"])
def test_the_mesh_of_a_link_is_upright_in_every_format(tmp_path: Path, ending: str) -> None:
    upright = trimesh.creation.box([0.1, 0.2, 0.3]).apply_translation([0.01, 0.02, 0.5])
    written = upright.copy()
    if ending == "glb":  # glTF has +y up: x, z, -y
        written.vertices = np.column_stack(
            [upright.vertices[:, 0], upright.vertices[:, 2], -upright.vertices[:, 1]]
        )
    path = tmp_path / f"link.{ending}"
    written.export(path)
    np.testing.assert_allclose(load_mesh(path, None).bounds, upright.bounds, atol=1e-6)
    scaled = load_mesh(path, [1.0, 2.0, 3.0])  # along the link's axes
    np.testing.assert_allclose(scaled.bounds, upright.bounds * [1.0, 2.0, 3.0], atol=1e-6)
