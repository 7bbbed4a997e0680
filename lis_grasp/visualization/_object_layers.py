"""Layers of the object and of its exploration: estimates, contacts, table, search and motion."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import combinations, pairwise, product
from typing import TYPE_CHECKING

import numpy as np
import trimesh

from lis_grasp.contacts import HALF_SPACE, Contacts
from lis_grasp.exceptions import counted, listed
from lis_grasp.exploration.observations import Maps
from lis_grasp.geometry import apply_pose, inverse_pose, make_pose, tangent_frame
from lis_grasp.typing import FloatArray
from lis_grasp.visualization import _drawing as drawing
from lis_grasp.visualization._drawing import OBJECT_NODE, ROOT, Canvas, Layer
from lis_grasp.visualization.colours import ColourScale, round_up

if TYPE_CHECKING:
    from lis_grasp.exploration import LoggedProbe, ProbeOutcome, Region
    from lis_grasp.world import Surroundings

TRUTH_COLOUR = "#5f86bd"
CONTACT_COLOUR, NORMAL_COLOUR = "#ff4d4d", "#f2912c"
BAD_COLOUR = "#8e44ad"
FREE_COLOUR = "#8fb7d8"
PLAIN_ESTIMATE_COLOUR = "#2c9a8f"
FIXED_COLOUR, LOOSE_COLOUR = "#8a6d4b", "#a0688f"
GLASS = 0.25
"""Opacity of bodies beside the object."""

TABLE_COLOUR, GRID_COLOUR = "#d2cfc9", "#a9a59d"

# Fractions of the markers' size, chosen by eye at 4 to 20 cm.
_CONTACT_RADIUS = 0.018
_NORMAL_LENGTH = 0.15
_FREE_POINT_RADIUS = 0.007
_FREE = "free-bodies"  # the layer
# Size of a doubted contact, in sizes of the ordinary marker that it covers.
_BAD_SIZE = 1.4

_MOST_FREE_POINTS = 5000


def draw_estimates(
    canvas: Canvas, surfaces: Sequence[tuple[int, trimesh.Trimesh]], size: float
) -> ColourScale | None:
    """Draw the estimates from increasing numbers of contacts; return their colour scale.

    The scale is for an object of `size` [m]; None if the last estimate has no finite uncertainty.
    """
    surfaces = [(count, mesh) for count, mesh in surfaces if len(mesh.faces)]
    if not surfaces:
        return None
    canvas.layers.append(
        Layer("estimate", "Estimated surface", True, PLAIN_ESTIMATE_COLOUR, "from the contacts")
    )
    scale = uncertainty_scale(surfaces[-1][1], size)
    for count, mesh in surfaces:
        path = f"{OBJECT_NODE}/estimate/{count}"
        canvas.commands.append(_draw_estimate(path, mesh, scale))
    return scale


def uncertainty_scale(mesh: trimesh.Trimesh, size: float) -> ColourScale | None:
    """Return the colour scale of an object of `size` [m]; None without finite uncertainty."""
    values = mesh.vertex_attributes.get("uncertainty")
    if values is None or not np.isfinite(values).any():
        return None
    return ColourScale.of_object(size, values)


def _draw_estimate(path: str, mesh: trimesh.Trimesh, scale: ColourScale | None) -> bytes:
    values = mesh.vertex_attributes.get("uncertainty")
    if scale is None or values is None:
        return drawing.draw_mesh(path, mesh, drawing.material(PLAIN_ESTIMATE_COLOUR))
    coloured = drawing.material(vertex_colours=True, roughness=0.65)
    return drawing.draw_mesh(path, mesh, coloured, scale.colours(values))


def draw_truth(canvas: Canvas, truth: trimesh.Trimesh) -> None:
    """Draw the true object."""
    solid = drawing.material(TRUTH_COLOUR, roughness=0.5)
    canvas.commands.append(drawing.draw_mesh(f"{OBJECT_NODE}/truth", truth, solid))
    canvas.layers.append(Layer("truth", "True object", True, TRUTH_COLOUR, "unknown to the robot"))


def free_body_node(number: int) -> str:
    """Return the node of the free body of a number, which moves in a lift."""
    return f"{ROOT}/{_FREE}/{number}"


def draw_surroundings(canvas: Canvas, surroundings: Surroundings) -> None:
    """Draw the bodies beside the object as glass, fixed ones and free ones as two layers."""
    fixed = [body for body in surroundings if body.is_fixed]
    for layer, title, colour, bodies in (
        ("surroundings", "Fixed bodies", FIXED_COLOUR, fixed),
        (_FREE, "Free bodies", LOOSE_COLOUR, surroundings.free),
    ):
        glass = drawing.material(colour, roughness=0.9, opacity=GLASS)
        for k, body in enumerate(bodies):
            path = free_body_node(k) if layer == _FREE else f"{ROOT}/{layer}/{k}"
            canvas.commands.append(drawing.draw_mesh(path, body.mesh, glass))
        if bodies:
            names = listed([body.name for body in bodies])
            canvas.layers.append(Layer(layer, title, True, colour, names))


def marker_size(points: FloatArray, least: float) -> float:
    """Return the size [m] of an object (N, 3) that its markers are scaled by, at least `least`.

    It is the geometric mean of the two largest extents: arrows for its length would hide a bar.
    """
    _, middle, largest = np.sort(np.ptp(points, axis=0))
    return max(float(np.sqrt(max(middle, 0.05 * largest) * largest)), least)


def draw_contacts(canvas: Canvas, contacts: Contacts, size: float) -> None:
    """Draw contacts, normals and free points as markers for an object of `size` [m]."""
    if len(contacts):
        at = _poses_along(contacts.points, contacts.normals)
        colours = {"contacts": CONTACT_COLOUR, "normals": NORMAL_COLOUR}
        for layer, part, mesh in _marker(size):
            path = f"{OBJECT_NODE}/{layer}/{part}"
            surface = drawing.material(colours[layer], roughness=0.4)
            canvas.commands.append(drawing.draw_copies(path, mesh, surface, at))
        many = counted(len(contacts), "contact")
        canvas.layers.append(Layer("contacts", many, True, CONTACT_COLOUR, "measured positions"))
        canvas.layers.append(Layer("normals", "Normals", True, NORMAL_COLOUR, "measured normals"))
    free = contacts.free_points[contacts.free_radii < HALF_SPACE]
    if len(free):
        shown = free[:: -(-len(free) // _MOST_FREE_POINTS)]
        at = make_pose(np.eye(3), shown)
        speck = trimesh.creation.icosphere(0, _FREE_POINT_RADIUS * size)
        colour = drawing.material(FREE_COLOUR, opacity=0.7)
        canvas.commands.append(drawing.draw_copies(f"{OBJECT_NODE}/free", speck, colour, at))
        canvas.layers.append(
            Layer("free", "Free space", False, FREE_COLOUR, "the hand passed there")
        )


def draw_bad_contacts(canvas: Canvas, contacts: Contacts, size: float) -> None:
    """Draw contacts that others contradict as larger balls with their measured normals."""
    if not len(contacts):
        return
    at = _poses_along(contacts.points, contacts.normals)
    for _, part, mesh in _marker(_BAD_SIZE * size):
        surface = drawing.material(BAD_COLOUR, roughness=0.4)
        canvas.commands.append(drawing.draw_copies(f"{OBJECT_NODE}/bad/{part}", mesh, surface, at))
    title = counted(len(contacts), "doubted contact")
    note = "turned or left out: others contradict them"
    canvas.layers.append(Layer("bad", title, True, BAD_COLOUR, note))


def draw_table(
    canvas: Canvas, object_points: FloatArray, outline: FloatArray, support_height: float
) -> float:
    """Draw a round table with a grid at `support_height` in O [m]; return the grid's spacing [m].

    `outline` (K, 3) [m] has points of everything that is drawn.
    """
    size = max(float(np.ptp(object_points, axis=0).max()), 1e-3)
    middle = 0.5 * (object_points.min(axis=0) + object_points.max(axis=0))[:2]
    farthest = float(np.linalg.norm(outline[:, :2] - middle, axis=1).max())
    radius = max(1.15 * farthest, 1.2 * size)
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


def _marker(size: float) -> list[tuple[str, str, trimesh.Trimesh]]:
    """Return layer, part and mesh of a ball and of an arrow along z."""
    radius, length = _CONTACT_RADIUS * size, _NORMAL_LENGTH * size
    head = 0.35 * length
    shaft = trimesh.creation.cylinder(0.36 * radius, segment=[[0, 0, 0], [0, 0, length - head]])
    cone = trimesh.creation.cone(1.0 * radius, head, sections=20)
    cone.apply_translation([0.0, 0.0, length - head])
    ball = trimesh.creation.icosphere(2, radius)
    return [("contacts", "ball", ball), ("normals", "shaft", shaft), ("normals", "head", cone)]


def _grid_lines(radius: float, spacing: float) -> FloatArray:
    """Return the lines, shape (E, 2, 3) [m], of a square grid inside a circle around the origin."""
    many = int(radius / spacing)
    offset = np.arange(-many, many + 1) * spacing
    half = np.sqrt(np.maximum(radius**2 - offset**2, 0.0))
    along = np.stack([np.column_stack([offset, s * half]) for s in (-1.0, 1.0)], axis=1)
    both = np.vstack([along, along[:, :, ::-1]])  # (2 (2 many + 1), 2, 2)
    return np.dstack([both, np.zeros(both.shape[:2])])


def _poses_along(points: FloatArray, directions: FloatArray) -> FloatArray:
    """Return poses (N, 4, 4) at `points` whose z axes are the unit `directions` (N, 3)."""
    axes = np.concatenate([tangent_frame(directions), directions[:, None]], axis=1)
    return make_pose(np.swapaxes(axes, 1, 2), points)


SEARCH_COLOUR = "#7a5ea8"

# Radii of the region's edges and of the fingertip's paths [m].
_EDGE_RADIUS, _PATH_RADIUS = 0.0005, 0.001
_END_RADIUS = 0.0035


TRACKED_COLOUR, TRUE_COLOUR = "#c2571a", "#4a4a4a"
_TRACKED_RADIUS, _TRUE_RADIUS = 0.0009, 0.0006  # [m]


def draw_search(canvas: Canvas, region: Region, search: Sequence[ProbeOutcome]) -> None:
    """Draw the region's edges and the path of the leading fingertip in every motion."""
    edges = [_tube(a, b, _EDGE_RADIUS) for a, b in _edges(region.bounds)]
    paths = [part for outcome in search for part in _path(outcome)]
    colour = drawing.material(SEARCH_COLOUR, roughness=0.7)
    mesh = trimesh.util.concatenate([*edges, *paths])
    canvas.commands.append(drawing.draw_mesh(f"{ROOT}/search/all", mesh, colour))
    lengths = " x ".join(f"{100.0 * length:.0f}" for length in region.lengths)
    seconds = sum(outcome.duration for outcome in search)
    many = counted(len(search), "motion")
    note = f"{many}, {seconds:.0f} s, in {lengths} cm"
    canvas.layers.append(Layer("search", "Region, search", True, SEARCH_COLOUR, note))


def _path(outcome: ProbeOutcome) -> list[trimesh.Trimesh]:
    """Return the path of the leading tip up to its end or the contact, with a ball there."""
    probe = outcome.probe
    if outcome.status == "blocked":
        return []
    end = probe.end
    if len(outcome.contacts):
        along = float(np.min((outcome.contacts.points - probe.start) @ probe.direction))
        end = probe.start + max(along, 0.0) * probe.direction
    ball = trimesh.creation.icosphere(2, _END_RADIUS)
    ball.apply_translation(end)
    if np.allclose(probe.start, end):
        return [ball]
    return [_tube(probe.start, end, _PATH_RADIUS), ball]


def _tube(start: FloatArray, end: FloatArray, radius: float) -> trimesh.Trimesh:
    return trimesh.creation.cylinder(radius, segment=[start, end], sections=8)


def _edges(bounds: FloatArray) -> list[tuple[FloatArray, FloatArray]]:
    """Return the 12 edges of a box, from its lowest and highest corner (2, 3)."""
    corners = list(product((0, 1), repeat=3))
    pairs = [pair for pair in combinations(corners, 2) if np.abs(np.subtract(*pair)).sum() == 1]
    axes = np.arange(3)
    return [(bounds[list(a), axes], bounds[list(b), axes]) for a, b in pairs]


def motion_paths(
    probes: Sequence[LoggedProbe], center: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Return the tracked and the true path of a point of the object, each (K, 3) [m].

    They are in the frame of the contacts after the last probe, where the object's frame is at its
    final pose; so is the point, `center` (3,). Probes before a loss of the object are left out.
    """
    frames, made, poses = [], [], []
    for entry in Maps.of([probe.observation for probe in probes]).present.entries:
        probe, belief = probes[entry.number], entry.observation.belief
        before = probe.observation.belief  # the true pose is in its frame; a map may be in another
        if probe.X_EO is not None and belief is not None and before is not None:
            frames.append(belief.X_WE)
            made.append(before.X_WE)
            poses.append(probe.X_EO)
    if not frames:
        return np.empty((0, 3)), np.empty((0, 3))
    X_EW, in_object = inverse_pose(frames[-1]), apply_pose(inverse_pose(poses[-1]), center)
    tracked = apply_pose(X_EW @ np.array(frames), center)
    return tracked, apply_pose(X_EW @ np.array(made) @ np.array(poses), in_object)


def draw_pose_track(canvas: Canvas, probes: Sequence[LoggedProbe], center: FloatArray) -> None:
    """Draw the tracked and the true path of a point (3,) that touches moved, if they did."""
    tracked, true = motion_paths(probes, center)
    reach = max(
        (float(np.ptp(path, axis=0).max()) for path in (tracked, true) if len(path)), default=0.0
    )
    if reach < _TRACKED_RADIUS:  # hidden in the line's own thickness
        return
    for name, path, radius, colour in (
        ("tracked", tracked, _TRACKED_RADIUS, TRACKED_COLOUR),
        ("true", true, _TRUE_RADIUS, TRUE_COLOUR),
    ):
        mesh = _line(path, radius)
        material = drawing.material(colour, roughness=0.7)
        canvas.commands.append(drawing.draw_mesh(f"{ROOT}/motion/{name}", mesh, material))
    moved = 1e3 * float(np.linalg.norm(true - true[0], axis=1).max())
    off = 1e3 * float(np.linalg.norm(tracked - true, axis=1).max())
    note = (
        f"of its middle, by up to {moved:.1f} mm under touch (grey); its tracked path is"
        f" never more than {off:.1f} mm off"
    )
    canvas.layers.append(Layer("motion", "Object's motion", True, TRACKED_COLOUR, note))


def _line(path: FloatArray, radius: float) -> trimesh.Trimesh:
    """Return a tube along a path (K, 3), with a ball at its end."""
    ball = trimesh.creation.icosphere(2, 3.0 * radius).apply_translation(path[-1])
    steps = [(a, b) for a, b in pairwise(path) if not np.allclose(a, b)]
    tubes = [trimesh.creation.cylinder(radius, segment=step, sections=8) for step in steps]
    return trimesh.util.concatenate([ball, *tubes])
