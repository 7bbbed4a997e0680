"""Looks of links, and the links of the arm that carries the hand at touches and grasps."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import trimesh

from lis_grasp.geometry import apply_pose
from lis_grasp.motion import Motion, arm_body
from lis_grasp.robots.link_bodies import load_visual
from lis_grasp.typing import FloatArray
from lis_grasp.visualization import _drawing as drawing
from lis_grasp.visualization._drawing import ROOT, Canvas

if TYPE_CHECKING:
    from lis_grasp.arms.station import Station
    from lis_grasp.robots.robot_model import RobotModel


ARM_COLOUR, FOOT_COLOUR = "#d9dbdf", "#7a8088"

PEDESTAL_COLOUR = "#b9b4aa"

_SEEDS = 4
# Length of the shown straight approach to a touch [m], and its number of places.
_APPROACH, _FRAMES = 0.15, 4
_MOMENTS = 12
_LEAST_PEDESTAL, _PEDESTAL_WIDTH = 0.01, 0.2  # [m]


_MOST_FACES = 4000  # of a link: a page holds all links, and a copy of each for every grasp
_CELLS = 48  # along the largest extent of a coarsened mesh


def draw_arm(canvas: Canvas, station: Station, *, first: int) -> None:
    """Draw the arm's links, like the hand's, at nodes numbered from `first` on."""
    fixed = station.arm.fixed_links
    for number, link in enumerate(station.arm.links, start=first):
        surface = drawing.material(FOOT_COLOUR if link in fixed else ARM_COLOUR, roughness=0.5)
        for part, mesh in enumerate(link_looks(station.arm, link)):
            path = f"{ROOT}/hand/{number}/{part}"
            canvas.commands.append(drawing.draw_mesh(path, mesh, surface))


def draw_pedestal(canvas: Canvas, station: Station) -> None:
    """Draw the column under the base, if the base is above its table."""
    table, base = station.table, station.X_WA[:3, 3]
    height = 0.0 if table is None else float(base[2] - table.height)
    if height < _LEAST_PEDESTAL:
        return
    feet = [g for g in station.arm.link_geometries if g.link == station.arm.base_link]
    wide = max((float(g.mesh.extents[:2].max()) for g in feet), default=_PEDESTAL_WIDTH)
    column = trimesh.creation.cylinder(0.5 * wide, height)
    column.apply_translation([base[0], base[1], base[2] - 0.5 * height])
    surface = drawing.material(PEDESTAL_COLOUR, roughness=0.8)
    canvas.commands.append(drawing.draw_mesh(f"{ROOT}/pedestal", column, surface))


def arm_points(station: Station, motion: Motion) -> FloatArray:
    """Return the corners of the arm's bodies, (N, 3) [m], at a few moments of a motion."""
    moments = np.unique(np.linspace(0, len(motion) - 1, _MOMENTS).astype(int))
    points = [np.zeros((0, 3))]
    for geometry in station.arm.link_geometries:
        if arm_body(geometry.link) in motion.poses:
            X_WG = motion.poses[arm_body(geometry.link)][moments] @ geometry.X_LG
            corners = trimesh.bounds.corners(geometry.mesh.bounds)
            points.append(apply_pose(X_WG, corners).reshape(-1, 3))
    return np.vstack(points)


def standing_points(station: Station) -> FloatArray:
    """Return the corners of the arm's bodies at home, and its foot on the table, (N, 3) [m]."""
    links = station.arm.forward_kinematics(station.X_WA, station.arm.home)
    foot = station.X_WA[:3, 3].copy()
    if station.table is not None:
        foot[2] = min(foot[2], station.table.height)
    points = [foot[None]]
    for geometry in station.arm.link_geometries:
        corners = trimesh.bounds.corners(geometry.mesh.bounds)
        points.append(apply_pose(links[geometry.link] @ geometry.X_LG, corners))
    return np.vstack(points)


def arm_poses(station: Station, X_OH: FloatArray) -> list[FloatArray]:
    """Return the poses of the arm's links in O, in order, with the palm at X_OH (4, 4).

    They are the solution of inverse kinematics nearest to home; home itself if there is none.
    """
    return _poses(station, _posture(station, X_OH))


def arm_approach(
    station: Station, X_OH: FloatArray, direction: FloatArray
) -> tuple[float, list[list[FloatArray]]]:
    """Return the length of a straight approach to X_OH (4, 4) [m], and the arm's poses on it.

    The poses are as in `arm_poses`, at even places from the palm's pose X_OH backwards along the
    `direction` (3,), as far as the arm reaches.
    """
    q = _posture(station, X_OH)
    frames = [_poses(station, q)]
    for place in np.linspace(0.0, _APPROACH, _FRAMES)[1:]:
        X = X_OH.copy()
        X[:3, 3] -= place * direction
        nearest, solved = station.follow(q[None], X[None])
        if not solved[0]:
            break
        q = nearest[0]
        frames.append(_poses(station, q))
    return _APPROACH * (len(frames) - 1) / (_FRAMES - 1), frames


def _posture(station: Station, X_OH: FloatArray) -> FloatArray:
    home: FloatArray = station.arm.home
    solutions = station.solve_ik(X_OH[None], seeds=_SEEDS, first=home)
    postures: FloatArray = solutions.q[0][solutions.solved[0]]
    return postures[np.argmin(np.linalg.norm(postures - home, axis=1))] if len(postures) else home


def _poses(station: Station, q: FloatArray) -> list[FloatArray]:
    return list(station.arm.forward_kinematics(station.X_WA, q).values())


def arm_tracks(station: Station, motion: Motion, *, first: int) -> list[tuple[str, FloatArray]]:
    """Return the recorded poses of the arm's links by node, numbered from `first` on."""
    return [
        (f"{ROOT}/hand/{number}", motion.poses[arm_body(link)])
        for number, link in enumerate(station.arm.links, start=first)
        if arm_body(link) in motion.poses
    ]


def link_looks(hand: RobotModel, link: str) -> list[trimesh.Trimesh]:
    """Return the meshes of a link in its frame [m], coarsened where they have many triangles."""
    loaded = [(v, load_visual(v)) for v in hand.visuals if v.link == link]
    drawn = [m.copy().apply_transform(v.X_LG) for v, m in loaded if m is not None]
    if not drawn:
        bodies = (body for body in hand.link_geometries if body.link == link)
        drawn = [body.mesh.copy().apply_transform(body.X_LG) for body in bodies]
    return [mesh if len(mesh.faces) <= _MOST_FACES else coarser(mesh) for mesh in drawn]


def coarser(mesh: trimesh.Trimesh) -> trimesh.Trimesh:
    """Return a mesh with the vertices of each cell of a grid joined at their mean.

    Vertex clustering (Rossignac and Borrel, 1993).
    """
    cell = float(mesh.extents.max()) / _CELLS or 1.0
    keys = np.floor((mesh.vertices - mesh.bounds[0]) / cell).astype(np.int64)
    _, cluster, counts = np.unique(keys, axis=0, return_inverse=True, return_counts=True)
    cluster = cluster.ravel()
    vertices = np.zeros((len(counts), 3))
    np.add.at(vertices, cluster, mesh.vertices)
    faces = cluster[mesh.faces]
    a, b, c = faces.T
    faces = faces[(a != b) & (b != c) & (c != a)]
    _, first = np.unique(np.sort(faces, axis=1), axis=0, return_index=True)
    return trimesh.Trimesh(vertices / counts[:, None], faces[np.sort(first)], process=False)
