"""Placement of objects on a table: stable poses, and places inside a region."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from lis_grasp import shapes
from lis_grasp.exceptions import InvalidFileError, InvalidOptionError
from lis_grasp.shapes import draw_pose, placed, roll_to_rest

REGION = (0.4, 0.4, 0.3)


@pytest.mark.parametrize("name", ["box", "mallet", "pentagon", "half_cylinder"])
def test_an_object_rolls_to_a_stable_pose_of_trimesh(name: str) -> None:
    mesh = shapes.build(name).mesh
    transforms, _ = mesh.compute_stable_poses()
    # The third row of a pose is the direction of the object that is up.
    ups = transforms[:, 2, :3]
    rng = np.random.default_rng(0)
    for _ in range(10):
        up = roll_to_rest(mesh, rng=rng)[2]
        assert np.min(np.linalg.norm(ups - up, axis=1)) < 1e-6


def test_every_face_of_a_box_is_rested_on() -> None:
    mesh, rng = shapes.build("box").mesh, np.random.default_rng(0)
    ups = {tuple(np.round(roll_to_rest(mesh, rng=rng)[2]).astype(int)) for _ in range(200)}
    assert len(ups) == 6


@pytest.mark.parametrize("pose", ["upright", "stable"])
def test_a_placed_object_rests_on_the_table_inside_the_region(pose: str) -> None:
    shape = shapes.build("mallet")
    for seed in range(10):
        X_WO = draw_pose(shape, pose, REGION, rng=np.random.default_rng(seed))
        there = placed(shape, X_WO)
        low, high = there.mesh.bounds
        assert abs(low[2]) < 1e-12
        assert high[2] < REGION[2]
        assert np.all(np.abs([low[:2], high[:2]]) <= 0.2 + 1e-12)
        assert there.mesh.volume == pytest.approx(shape.mesh.volume, rel=1e-9)
        on_edges = there.edges.reshape(-1, 3)
        back = (on_edges - X_WO[:3, 3]) @ X_WO[:3, :3]
        assert np.abs(back - shape.edges.reshape(-1, 3)).max() < 1e-12
        if pose == "upright":
            assert np.allclose(X_WO[2, :3], [0.0, 0.0, 1.0])


def test_seeds_place_an_object_differently() -> None:
    shape = shapes.build("box")
    places = [
        draw_pose(shape, "upright", REGION, rng=np.random.default_rng(seed))[:2, 3]
        for seed in (0, 1, 1)
    ]
    assert np.linalg.norm(places[0] - places[1]) > 1e-3
    assert np.array_equal(places[1], places[2])


def test_a_pose_is_read_from_a_file_and_put_on_the_table(tmp_path: Path) -> None:
    shape, wanted = shapes.build("box"), np.eye(4)
    wanted[:3, 3] = 0.05, -0.02, 7.0
    np.savetxt(tmp_path / "pose.txt", wanted)
    X_WO = draw_pose(shape, str(tmp_path / "pose.txt"), REGION, rng=np.random.default_rng(0))
    assert np.allclose(X_WO[:2, 3], [0.05, -0.02])
    assert abs(placed(shape, X_WO).mesh.bounds[0, 2]) < 1e-12


def test_a_region_that_is_too_small_is_refused() -> None:
    with pytest.raises(InvalidOptionError) as error:
        draw_pose(shapes.build("box"), "stable", (0.05, 0.4, 0.3), rng=np.random.default_rng(0))
    assert error.value.option == "region"


@pytest.mark.parametrize(
    "text", ["1 2 3", "not numbers", "\n".join(["2 0 0 0", "0 1 0 0", "0 0 1 0", "0 0 0 1"])]
)
def test_a_file_without_a_pose_is_refused(tmp_path: Path, text: str) -> None:
    (tmp_path / "pose.txt").write_text(text)
    with pytest.raises(InvalidFileError) as error:
        draw_pose(
            shapes.build("box"), str(tmp_path / "pose.txt"), REGION, rng=np.random.default_rng(0)
        )
    assert error.value.path == tmp_path / "pose.txt"


def test_a_missing_file_is_refused() -> None:
    with pytest.raises(InvalidFileError) as error:
        draw_pose(shapes.build("box"), "nowhere.txt", REGION, rng=np.random.default_rng(0))
    assert error.value.path == Path("nowhere.txt")


@pytest.mark.parametrize("pose", [np.eye(3), [["a"]], None, np.full((4, 4), np.nan)])
def test_a_damaged_pose_is_refused(pose: object) -> None:
    with pytest.raises(InvalidOptionError) as error:
        placed(shapes.build("box"), pose)  # type: ignore[arg-type]
    assert error.value.option == "X_WO"
