"""The object's layers: estimate, true object, contacts, and the table below."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
import trimesh

from lis_grasp.contacts import Contacts
from lis_grasp.visualization import drawing
from lis_grasp.visualization.camera import box_corners
from lis_grasp.visualization.canvas import OBJECT_NODE, ROOT, Canvas, Layer
from lis_grasp.visualization.colours import ColourScale, round_up

FloatArray = npt.NDArray[np.float64]

TRUTH_COLOUR = "#5f86bd"
CONTACT_COLOUR = "#ff4d4d"
FREE_COLOUR = "#8fb7d8"
PLAIN_ESTIMATE_COLOUR = "#2c9a8f"
TABLE_COLOUR, GRID_COLOUR = "#d2cfc9", "#a9a59d"

# Sizes as shares of the object's largest extent, found by eye at 4 to 20 cm.
_CONTACT_RADIUS = 0.018
_NORMAL_LENGTH = 0.15
_FREE_POINT_RADIUS = 0.007

_MOST_FREE_POINTS = 5000


def draw_estimate(canvas: Canvas, estimate: trimesh.Trimesh) -> ColourScale | None:
    """Draw the estimated surface and return the scale of its colours, None for one plain colour."""
    if not len(estimate.faces):
        return None
    path = f"{OBJECT_NODE}/estimate"
    canvas.layers.append(Layer("estimate", "Estimated surface", True, PLAIN_ESTIMATE_COLOUR))
    values = estimate.vertex_attributes.get("uncertainty")
    if values is None or not np.isfinite(values).any():
        plain = drawing.material(PLAIN_ESTIMATE_COLOUR)
        canvas.commands.append(drawing.draw_mesh(path, estimate, plain))
        return None
    scale = ColourScale.of(values)
    coloured = drawing.material(vertex_colours=True, roughness=0.65)
    colours = scale.colours(values)
    canvas.commands.append(drawing.draw_mesh(path, estimate, coloured, colours))
    return scale


def draw_truth(canvas: Canvas, truth: trimesh.Trimesh) -> None:
    """Draw the true object."""
    solid = drawing.material(TRUTH_COLOUR, roughness=0.5)
    canvas.commands.append(drawing.draw_mesh(f"{OBJECT_NODE}/truth", truth, solid))
    canvas.layers.append(Layer("truth", "True object", True, TRUTH_COLOUR))


def draw_contacts(canvas: Canvas, contacts: Contacts, size: float) -> None:
    """Draw contacts with their normals, and free points, for an object of `size` [m]."""
    if len(contacts):
        at = _poses_along(contacts.points, contacts.normals)
        colour = drawing.material(CONTACT_COLOUR, roughness=0.4)
        for name, mesh in _marker(size).items():
            path = f"{OBJECT_NODE}/contacts/{name}"
            canvas.commands.append(drawing.draw_copies(path, mesh, colour, at))
        label = f"{len(contacts)} contact{'s' if len(contacts) > 1 else ''} and normals"
        canvas.layers.append(Layer("contacts", label, True, CONTACT_COLOUR))
    free = contacts.free_points
    if len(free):
        shown = free[:: -(-len(free) // _MOST_FREE_POINTS)]
        at = np.tile(np.eye(4), (len(shown), 1, 1))
        at[:, :3, 3] = shown
        speck = trimesh.creation.icosphere(0, _FREE_POINT_RADIUS * size)
        colour = drawing.material(FREE_COLOUR, opacity=0.7)
        canvas.commands.append(drawing.draw_copies(f"{OBJECT_NODE}/free", speck, colour, at))
        canvas.layers.append(Layer("free", "Where nothing was felt", False, FREE_COLOUR))


def draw_table(
    canvas: Canvas, object_points: FloatArray, outline: FloatArray, support_height: float
) -> float:
    """Draw a round table with a grid below the object and return the grid's spacing [m].

    Parameters
    ----------
    object_points, outline
        Shapes (N, 3), (K, 3) [m], in O: points of the object, and of all there is to see.
    support_height
        Height of the table in O [m].
    """
    size = max(float(np.ptp(object_points, axis=0).max()), 1e-3)
    middle = box_corners(object_points)[:, :2].mean(axis=0)
    reach = float(np.linalg.norm(outline[:, :2] - middle, axis=1).max())
    radius = max(1.15 * reach, 1.2 * size)
    thickness = 0.035 * radius
    centre = np.array([*middle, support_height])
    top = trimesh.creation.cylinder(radius, thickness, sections=160)
    top.apply_translation(centre - [0.0, 0.0, thickness / 2.0])
    table = drawing.material(TABLE_COLOUR, roughness=0.9)
    canvas.commands.append(drawing.draw_mesh(f"{ROOT}/table", top, table))
    spacing = round_up(0.2 * size)
    lines = _grid_lines(0.985 * radius, spacing) + centre
    canvas.commands.append(drawing.draw_segments(f"{ROOT}/grid", lines, GRID_COLOUR))
    return spacing


def _marker(size: float) -> dict[str, trimesh.Trimesh]:
    """Return a ball and an arrow along z from the origin, for an object of `size` [m]."""
    radius, length = _CONTACT_RADIUS * size, _NORMAL_LENGTH * size
    head = 0.35 * length
    shaft = trimesh.creation.cylinder(0.36 * radius, segment=[[0, 0, 0], [0, 0, length - head]])
    cone = trimesh.creation.cone(1.0 * radius, head, sections=20)
    cone.apply_translation([0.0, 0.0, length - head])
    return {"ball": trimesh.creation.icosphere(2, radius), "shaft": shaft, "head": cone}


def _grid_lines(radius: float, spacing: float) -> FloatArray:
    """Return the lines, shape (E, 2, 3) [m], of a square grid inside a circle round the origin."""
    many = int(radius / spacing)
    offset = np.arange(-many, many + 1) * spacing
    half = np.sqrt(np.maximum(radius**2 - offset**2, 0.0))
    along = np.stack(
        [np.stack([offset, -half], axis=1), np.stack([offset, half], axis=1)], axis=1
    )  # (2 many + 1, 2, 2)
    both = np.vstack([along, along[:, :, ::-1]])
    return np.dstack([both, np.zeros(both.shape[:2])])


def _poses_along(points: FloatArray, directions: FloatArray) -> FloatArray:
    """Return poses (N, 4, 4) at `points` whose z axes are the unit `directions` (N, 3)."""
    # The axis least like z gives the steadiest cross product.
    helper = np.eye(3)[np.argmin(np.abs(directions), axis=1)]
    x = np.cross(helper, directions)
    x /= np.linalg.norm(x, axis=1, keepdims=True)
    poses = np.zeros((len(points), 4, 4))
    poses[:, :3, 0], poses[:, :3, 1] = x, np.cross(directions, x)
    poses[:, :3, 2], poses[:, :3, 3], poses[:, 3, 3] = directions, points, 1.0
    return poses
