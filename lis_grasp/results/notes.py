"""Notes on the true object before a run: its mesh, its width, and views that do not show it."""

from __future__ import annotations

import numpy as np
import trimesh

from lis_grasp.grasping.hand_capacity import narrowest_width
from lis_grasp.results.progress import Progress
from lis_grasp.robots.hand import Hand
from lis_grasp.robots.hand_check import opening_range
from lis_grasp.shapes import STABLE, UPRIGHT, Shape
from lis_grasp.shapes.mesh_distance import distances_to_mesh
from lis_grasp.stages.scenario import Scenario
from lis_grasp.views.object_mask import LOWEST

WARNING = "warning: "
"""Start of a note that warns."""

# Seen contacts by which a view is compared with the object, and deviations of their place.
_SEEN, _DEVIATIONS = 100, 3.0


def say_object(scenario: Scenario, progress: Progress) -> None:
    """Report the repairs of the true object's mesh, if it is too wide, and if no view shows it."""
    say_repairs(scenario.truth.shape, progress)
    say_unseen(scenario, progress)
    say_width(scenario.truth.shape.mesh, scenario.agent.hand, progress)


def say_repairs(shape: Shape, progress: Progress) -> None:
    """Report the repairs of an object's mesh."""
    for repair in shape.repairs:
        progress.say(f"repaired: {repair}")


def say_unseen(scenario: Scenario, progress: Progress) -> None:
    """Report views of something else than the true object where it stands.

    Half of what they show is farther from it than the error of the camera's pose explains.
    """
    views, mesh = scenario.agent.views, scenario.truth.shape.mesh
    if views is None or not scenario.task.known.views:
        return
    contacts = views.contacts(_SEEN)
    if not len(contacts):
        return
    away = float(np.median(distances_to_mesh(contacts.points, mesh)[0]))
    if away > LOWEST + _DEVIATIONS * views.displacement:
        is_random = scenario.task.world.pose in (UPRIGHT, STABLE)
        progress.say(
            f"{WARNING}the view shows an object {1e3 * away:.0f} mm away from the surface of the"
            f" simulated one{', which is at a random pose' * is_random}: `pose` gives the pose that"
            " the view shows"
        )


def say_width(mesh: trimesh.Trimesh, hand: Hand, progress: Progress) -> None:
    """Report whether a mesh is too wide for the hand."""
    low, high = opening_range(hand)
    if not 0.0 < high < float(mesh.extents.min()):  # the box bounds the width
        return
    width = narrowest_width(mesh)
    if width > high:
        progress.say(
            f"{WARNING}the object is {1e3 * width:.0f} mm wide where it is narrowest, and"
            f" pads of {hand.name} are {1e3 * low:.0f} to {1e3 * high:.0f} mm apart: only a rim or"
            " a handle can be grasped; check the units of the mesh (`units`), or take a smaller"
            " object"
        )
