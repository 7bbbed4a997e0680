"""Grasps on an object that is held in the air: no plane is in the way."""

from pathlib import Path

import pytest
import trimesh

from lis_grasp import pipeline
from lis_grasp.io import provenance

_OF_THE_PLANE = ("approach_hits_support", "grasp_hits_support")


def test_no_plane_is_in_the_way_of_an_object_in_the_air(tmp_path: Path) -> None:
    path = tmp_path / "plate.stl"
    trimesh.creation.box((0.1, 0.04, 0.004)).export(path)
    options = {"hand": "wsg50", "grasps": 3}
    lying = pipeline.grasp_file(path, tmp_path, **options)
    rejected = {name: lying.search.rejections.get(name, 0) for name in _OF_THE_PLANE}
    assert sum(rejected.values()) > 0
    assert provenance.read(lying.path)["support_height"] == pytest.approx(-0.002)
    held = pipeline.grasp_file(path, tmp_path, support="none", **options)
    assert not any(held.search.rejections.get(name, 0) for name in _OF_THE_PLANE)
    assert len(held.search) == 3
    assert "support_height" not in provenance.read(held.path)
    # From below, where the table was.
    assert min(grasp.approach_O[2] for grasp in held.search) > min(
        (grasp.approach_O[2] for grasp in lying.search), default=-1.0
    )
