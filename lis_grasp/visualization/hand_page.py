"""Page of a hand: links in every posture, palm frame H, pads with their axes, leading tips."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np
import trimesh

from lis_grasp.geometry import make_pose
from lis_grasp.typing import FloatArray
from lis_grasp.visualization import _drawing as drawing
from lis_grasp.visualization._drawing import OBJECT_NODE, ROOT, Canvas, Layer
from lis_grasp.visualization._object_layers import draw_table
from lis_grasp.visualization._page import build_overlay, build_page
from lis_grasp.visualization._story import Story
from lis_grasp.visualization.camera import ELEVATION, outermost
from lis_grasp.visualization.hand_layers import LINK_COLOUR, column_major, draw_hand, hand_points

if TYPE_CHECKING:
    from lis_grasp.robots.hand import Hand

AXIS_COLOURS = ("#d64545", "#3f9b50", "#3d6fd6")
PAD_MARK, TIP_MARK = "#f2912c", "#b04fc4"
_AXIS_LENGTH, _AXIS_RADIUS = 0.05, 0.0012  # [m]
_MARK = 0.004  # radius of the mark of a flat pad [m]


def hand_page(hand: Hand, *, summary: tuple[str, ...] = ()) -> str:
    """Return an HTML page of a hand, in its base link's frame turned so that the approach is down.

    The axes of H are red (x), green (y) and blue (z); orange marks are the pads with their axes,
    purple ones the leading spheres of the probe postures.
    """
    canvas = Canvas()
    turn = trimesh.geometry.align_vectors(hand.approach_H, [0.0, 0.0, -1.0])
    X_OH = make_pose(turn[:3, :3])
    postures = [(f"pregrasp {name}", q) for name, q in hand.pregrasps.items()]
    postures += [(f"probe posture {f}", p.joint_positions) for f, p in hand.probe_postures.items()]
    draw_hand(canvas, hand)
    _draw_marks(canvas, hand)
    for axis, colour, mesh in zip("xyz", AXIS_COLOURS, _frame(X_OH), strict=True):
        path = f"{OBJECT_NODE}/frame/{axis}"
        canvas.commands.append(drawing.draw_mesh(path, mesh, drawing.material(colour)))
    poses = []
    for number, (label, q) in enumerate(postures, start=1):
        links = hand.forward_kinematics(X_OH, q)
        poses.append([links[link] for link in hand.links])
        canvas.layers.append(Layer(f"grasp-{number}", label, True, LINK_COLOUR))
    points = np.vstack([hand_points(hand, posture) for posture in poses])
    outline = outermost(points)
    grid = draw_table(canvas, points, outline, float(points[:, 2].min()) - 0.01)
    story = Story.of(contacts=0, surfaces=[], grasps=len(poses), lift_seconds=0.0)
    story = Story(tuple(replace(chapter, label="Postures") for chapter in story.chapters))
    seen = np.round(outline, 5).tolist()
    facts = {
        "grasps": [[column_major(X) for X in posture] for posture in poses],
        "touches": [],
        "story": {**story.facts(), "postures": [label for label, _ in postures]},
        "camera": {
            "azimuth": -55.0,
            "elevation": round(float(np.rad2deg(ELEVATION)), 3),
            "object": seen,
            "hand": seen,
            "moved": [],
        },
    }
    title = f"Hand {hand.name}"
    overlay = build_overlay(
        title, summary, layers=canvas.layers, scale=None, grid=grid, story=story, postures=True
    )
    return build_page(title, canvas, overlay=overlay, scene=facts)


def _draw_marks(canvas: Canvas, hand: Hand) -> None:
    """Draw pads and leading tips at the nodes of their links, which move with these."""
    number = {link: k for k, link in enumerate(hand.links)}
    for pad in hand.pads:
        for part, mesh in enumerate(_pad_marks(pad.center_L, pad.radius, pad.axis_L)):
            path = f"{ROOT}/hand/{number[pad.link]}/pad_{pad.finger}_{part}"
            canvas.commands.append(drawing.draw_mesh(path, mesh, drawing.material(PAD_MARK)))
    for finger, posture in hand.probe_postures.items():
        ball = trimesh.creation.icosphere(subdivisions=2, radius=1.03 * posture.radius)
        ball.apply_translation(posture.center_L)
        path = f"{ROOT}/hand/{number[posture.link]}/tip_{finger}"
        canvas.commands.append(drawing.draw_mesh(path, ball, drawing.material(TIP_MARK)))


def _pad_marks(center: FloatArray, radius: float, axis: FloatArray) -> Iterator[trimesh.Trimesh]:
    ball = trimesh.creation.icosphere(subdivisions=2, radius=1.02 * radius or _MARK)
    yield ball.apply_translation(center)
    start = center + radius * axis
    yield _bar(start, start + 0.02 * axis)


def _frame(X: FloatArray) -> list[trimesh.Trimesh]:
    return [_bar(X[:3, 3], X[:3, 3] + _AXIS_LENGTH * X[:3, k]) for k in range(3)]


def _bar(start: FloatArray, end: FloatArray) -> trimesh.Trimesh:
    return trimesh.creation.cylinder(_AXIS_RADIUS, segment=[start, end], sections=16)
