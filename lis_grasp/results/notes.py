"""Notes on the true object before a run: repairs of its mesh, and whether it is too wide."""

from __future__ import annotations

import trimesh

from lis_grasp.grasping.hand_capacity import narrowest_width
from lis_grasp.results.progress import Progress
from lis_grasp.robots.hand import Hand
from lis_grasp.robots.hand_check import opening_range
from lis_grasp.shapes import Shape
from lis_grasp.stages.scenario import Scenario

WARNING = "warning: "
"""Start of a note that warns."""


def say_object(scenario: Scenario, progress: Progress) -> None:
    """Report the repairs of the true object's mesh, and whether it is too wide for the hand."""
    say_repairs(scenario.truth.shape, progress)
    say_width(scenario.truth.shape.mesh, scenario.agent.hand, progress)


def say_repairs(shape: Shape, progress: Progress) -> None:
    """Report the repairs of an object's mesh."""
    for repair in shape.repairs:
        progress.say(f"repaired: {repair}")


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
