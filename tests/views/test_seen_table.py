"""The table in an image shows whether the pose of its camera and the table's height agree."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import trimesh

from lis_grasp.exceptions import InvalidViewError, LisGraspWarning
from lis_grasp.geometry import inverse_pose
from lis_grasp.results.seen import see
from lis_grasp.stages.looking import load_views
from lis_grasp.task.task import Task
from lis_grasp.views import DepthCamera, DepthNoise, DepthView, HandEye, look_at, simulate_view
from lis_grasp.views.seen_table import SeenTable, doubt_of_seen_table, require_level_table

BOX = trimesh.creation.box([0.1, 0.06, 0.05]).apply_translation([0.0, 0.0, 0.025])
X_WC = look_at([0.45, -0.1, 0.4], [0.0, 0.0, 0.03])


@pytest.fixture(scope="module")
def view() -> DepthView:
    rng = np.random.default_rng(0)
    return simulate_view([BOX], X_WC, DepthCamera(noise=DepthNoise.none()), rng=rng)


def _off(view: DepthView, *, up: float) -> DepthView:
    pose = view.X_WC.copy()
    pose[2, 3] += up
    return view.posed(pose)


@pytest.mark.parametrize("up", [-0.02, 0.0, 0.02])
def test_the_table_is_seen_where_the_pose_of_the_camera_puts_it(view: DepthView, up: float) -> None:
    table = SeenTable.of(_off(view, up=up), 0.0)
    assert table.height(np.zeros(3)) == pytest.approx(up, abs=1e-3)
    assert table.lean < np.deg2rad(0.2)


def test_a_camera_that_is_20_mm_too_high_is_told(view: DepthView) -> None:
    assert doubt_of_seen_table(view, 0.0) == ""
    assert "is 20 mm above its height of 0 mm" in doubt_of_seen_table(_off(view, up=0.02), 0.0)
    assert "is 20 mm below its height of 20 mm" in doubt_of_seen_table(view, 0.02)


def test_a_known_error_of_the_pose_explains_the_table(view: DepthView) -> None:
    off = _off(view, up=0.008)
    assert "the error of the camera's pose explains 3 mm" in doubt_of_seen_table(off, 0.0)
    assert doubt_of_seen_table(replace(off, hand_eye=HandEye(0.01, 0.0)), 0.0) == ""


@pytest.mark.parametrize("is_masked", [True, False])
def test_an_inverted_pose_is_refused_by_its_name(view: DepthView, is_masked: bool) -> None:
    given = view if is_masked else replace(view, mask=None)
    require_level_table(given, 0.0)
    with pytest.raises(InvalidViewError, match="the pose looks inverted"):
        require_level_table(given.posed(inverse_pose(view.X_WC)), 0.0)


def test_a_table_above_the_camera_is_refused(view: DepthView) -> None:
    turned = view.X_WC.copy()
    turned[1:3] *= -1.0  # half a turn about x
    with pytest.raises(InvalidViewError, match="leans by 180 deg"):
        require_level_table(view.posed(turned), 0.0)


def test_an_image_of_the_object_alone_needs_no_table(view: DepthView) -> None:
    alone = replace(view, depth=np.where(view.object_mask, view.depth, np.nan))
    require_level_table(alone, 0.0)
    assert doubt_of_seen_table(alone, 0.0) == ""
    assert "shows no table" in doubt_of_seen_table(_off(view, up=0.3), 0.0)


def test_see_and_what_takes_a_view_tell_the_doubt(view: DepthView, tmp_path: Path) -> None:
    seen = see(replace(_off(view, up=0.02), mask=None), 0.0, tmp_path)
    assert seen.summary[-1].startswith("warning: the table in the image is 20 mm above")
    assert "is 20 mm above" in (tmp_path / "seen.html").read_text(encoding="utf-8")
    with pytest.warns(LisGraspWarning, match=r"view\.npz: the table in the image is 20 mm above"):
        list(load_views([tmp_path / "view.npz"], Task.of("box"), 0.0))
    assert len(see(view, 0.0, tmp_path / "right").summary) == 2
