"""Looks at the object before its first touch: simulated ones, and recorded views."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from lis_grasp.exceptions import NothingSeenError, note
from lis_grasp.exploration import Region
from lis_grasp.shapes import Shape
from lis_grasp.stages.random_streams import Stream
from lis_grasp.task.task import Task
from lis_grasp.views import (
    DepthCamera,
    DepthNoise,
    DepthView,
    HandEye,
    Views,
    draw_camera_pose,
    load_view,
    segment_object,
    simulate_view,
)
from lis_grasp.views.seen_table import doubt_of_seen_table, require_level_table


def views_of(task: Task, shape: Shape, support_height: float) -> Views | None:
    """Return what the cameras of a task saw of its object; None without a camera.

    Recorded views come first. The object's pixels are those above the table at a height [m], unless
    a recorded view has a mask.

    Raises `InvalidFileError` if a recorded view cannot be used, `NothingSeenError` if one shows
    nothing on the table.
    """
    views = list(load_views(task.known.views or (), task, support_height))
    if task.robot.camera:
        view = look(task, shape, support_height)
        try:
            views.append(_segmented(view, task, support_height))
        except NothingSeenError as error:
            note(f"{error}; the simulated camera knows its pixels")
            views.append(view)
    return Views(tuple(views), support_height) if views else None


def load_views(
    paths: Sequence[Path | str], task: Task, support_height: float
) -> Iterator[DepthView]:
    """Load views of an object on a table at a height [m], and find its pixels; see `views_of`.

    They have the task's error between camera and hand. A warning says if the table is seen
    elsewhere than this error explains; raises `InvalidViewError` if it is not level.
    """
    for path in paths:
        view = replace(load_view(path), hand_eye=HandEye(*task.robot.hand_eye))
        require_level_table(view, support_height)
        view = view if view.mask is not None else _segmented(view, task, support_height)
        if doubt := doubt_of_seen_table(view, support_height):
            note(f"{path}: {doubt}")
        yield view


def _segmented(view: DepthView, task: Task, support_height: float) -> DepthView:
    """Return a view with the object's pixels, found above the table in the task's region."""
    region = task.known.region
    bounds = None if region is None else Region(region).bounds
    return segment_object(view, support_height, bounds)


def look(task: Task, shape: Shape, support_height: float) -> DepthView:
    """Return what a simulated camera sees of an object from a random side, with its true mask."""
    rng, robot = Stream.VIEW.rng(task.seed), task.robot
    noise = DepthNoise() if robot.depth_noise == "stereo" else DepthNoise.none()
    camera = DepthCamera(noise=noise, hand_eye=HandEye(*robot.hand_eye))
    X_WC = draw_camera_pose(shape.mesh.bounds.mean(axis=0), rng=rng)
    view = simulate_view([shape.mesh], X_WC, camera, rng=rng, support_height=support_height)
    return replace(view, depth=view.depth.astype(np.float32))  # as cameras have it
