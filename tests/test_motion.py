"""Motion: validation, relative poses, load and save."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from lis_grasp.exceptions import InvalidFileError, InvalidOptionError
from lis_grasp.motion import Motion


def _motion(count: int = 5, *, seed: int = 0) -> Motion:
    rng = np.random.default_rng(seed)
    poses = {}
    for name in ("palm", "object"):
        X = np.tile(np.eye(4), (count, 1, 1))
        X[:, :3, :3] = Rotation.random(count, rng=rng).as_matrix()
        X[:, :3, 3] = rng.normal(size=(count, 3))
        poses[name] = X
    return Motion(np.linspace(0.0, 1.0, count), poses)


def test_equal_motions_write_equal_bytes(tmp_path: Path) -> None:
    _motion().save(tmp_path / "a.npz")
    _motion().save(tmp_path / "b.npz")
    assert (tmp_path / "a.npz").read_bytes() == (tmp_path / "b.npz").read_bytes()


def test_a_body_carried_rigidly_keeps_its_relative_pose() -> None:
    motion = _motion()
    offset = np.eye(4)
    offset[:3, 3] = [0.01, 0.02, 0.03]
    carried = Motion(
        motion.times, {"palm": motion.poses["palm"], "object": motion.poses["palm"] @ offset}
    )
    # Products of rotations of order one: a few rounding errors.
    np.testing.assert_allclose(
        carried.relative("object", "palm"), np.tile(offset, (5, 1, 1)), atol=1e-14
    )


def test_arrays_of_a_motion_cannot_be_changed() -> None:
    motion = _motion()
    with pytest.raises(ValueError, match="read-only"):
        motion.poses["palm"][0, 0, 3] = 1.0
    with pytest.raises(ValueError, match="read-only"):
        motion.times[0] = 1.0


def test_duration_is_from_first_to_last_time() -> None:
    assert _motion().duration == 1.0
    assert Motion(np.empty(0), {"object": np.empty((0, 4, 4))}).duration == 0.0


@pytest.mark.parametrize(
    ("times", "X"),
    [
        ([0.0, 0.0], np.tile(np.eye(4), (2, 1, 1))),
        ([0.0, np.nan], np.tile(np.eye(4), (2, 1, 1))),
        ([0.0, 1.0], np.eye(4)[None]),
        ([0.0, 1.0], np.tile(np.diag([2.0, 1.0, 1.0, 1.0]), (2, 1, 1))),
        ([0.0, 1.0], np.full((2, 4, 4), np.nan)),
    ],
    ids=[
        "equal times",
        "time not a number",
        "a pose missing",
        "scaled pose",
        "pose not a number",
    ],
)
def test_an_invalid_motion_is_refused(times: list[float], X: np.ndarray) -> None:
    with pytest.raises(InvalidOptionError) as error:
        Motion(np.array(times), {"object": X})
    assert error.value.option in ("times", "poses")


def test_an_unknown_body_is_named_in_the_error() -> None:
    with pytest.raises(InvalidOptionError) as error:
        _motion().relative("thumb", "palm")
    assert (error.value.option, error.value.value) == ("body", "thumb")


def test_a_file_without_a_motion_is_refused(tmp_path: Path) -> None:
    (tmp_path / "text.npz").write_text("hello")
    np.savez(tmp_path / "other.npz", x=np.zeros(3))
    np.savez(
        tmp_path / "half.npz",
        times=np.zeros(2),
        names=np.array(["a"]),
        poses=np.zeros((1, 2, 4, 4)),
    )
    _motion().save(tmp_path / "cut.npz")
    (tmp_path / "cut.npz").write_bytes((tmp_path / "cut.npz").read_bytes()[:300])
    np.savez(
        tmp_path / "shape.npz", times=np.zeros(2), names=np.array("a"), poses=np.zeros((1, 4, 4))
    )
    for name in ("missing", "text", "other", "half", "cut", "shape"):
        path = tmp_path / f"{name}.npz"
        with pytest.raises(InvalidFileError) as error:
            Motion.load(path)
        assert error.value.path == path
