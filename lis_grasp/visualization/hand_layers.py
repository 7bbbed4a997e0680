"""Layers of the hand, its touches, grasps and lift in a scene; the page of a hand alone."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np
import trimesh

from lis_grasp.exceptions import InvalidOptionError
from lis_grasp.geometry import apply_pose, inverse_pose, make_pose
from lis_grasp.motion import OBJECT, Motion, beside_body
from lis_grasp.typing import FloatArray
from lis_grasp.visualization import _drawing as drawing
from lis_grasp.visualization._arm_layer import (
    arm_approach,
    arm_poses,
    arm_tracks,
    draw_arm,
    link_looks,
)
from lis_grasp.visualization._drawing import OBJECT_NODE, ROOT, Canvas, Layer
from lis_grasp.visualization._object_layers import draw_table, free_body_node
from lis_grasp.visualization._page import PageContent, build_overlay, build_page, column_major
from lis_grasp.visualization._story import Story
from lis_grasp.visualization.camera import CameraView, choose_azimuth, outermost, surface_points
from lis_grasp.world import ALONE, Surroundings

if TYPE_CHECKING:
    from lis_grasp.arms.station import Station
    from lis_grasp.exploration import ProbeOutcome
    from lis_grasp.grasping.grasps import Grasp
    from lis_grasp.robots.hand import Hand


PALM_COLOUR, LINK_COLOUR, PAD_COLOUR = "#3a3f47", "#565d68", "#e4e2dc"

# The best grasp has the colours of the hand; the others are tinted.
GRASP_COLOURS = (LINK_COLOUR, "#c9792f", "#8a5fbf", "#b8577f", "#7d6a4c")

# Moments of a lift that frame the camera; bodies move little between two of them.
_MOMENTS = 25

AXIS_COLOURS = ("#d64545", "#3f9b50", "#3d6fd6")
PAD_MARK, TIP_MARK = "#f2912c", "#b04fc4"
_AXIS_LENGTH, _AXIS_RADIUS = 0.05, 0.0012  # [m]
_MARK = 0.004  # radius of the mark of a flat pad [m]


def draw_hand(canvas: Canvas, hand: Hand, station: Station | None = None) -> None:
    """Draw the hand's links, each at its own node, which the page copies and places.

    The links of the station's arm follow.
    """
    for number, link in enumerate(hand.links):
        colour = link_colour(hand, link)
        surface = drawing.material(colour, roughness=0.7 if colour == PAD_COLOUR else 0.45)
        for part, mesh in enumerate(link_looks(hand, link)):
            path = f"{ROOT}/hand/{number}/{part}"
            canvas.commands.append(drawing.draw_mesh(path, mesh, surface))
    if station is not None:
        draw_arm(canvas, station, first=len(hand.links))
    canvas.layers.append(Layer("hand", "Robot hand", True, LINK_COLOUR))


def link_colour(hand: Hand, link: str) -> str:
    """Return the colour of a link: that of the palm, of links with pads, or of the others."""
    if any(pad.link == link for pad in hand.pads):
        return PAD_COLOUR
    return PALM_COLOUR if link == hand.links[0] else LINK_COLOUR


def draw_grasps(canvas: Canvas, grasps: Sequence[Grasp]) -> None:
    """Add a layer for each grasp, best first, and one that shows all at once."""
    for rank, grasp in enumerate(grasps, start=1):
        quality = ", ".join(f"{name} {value:.3g}" for name, value in grasp.quality.items())
        turn = rank - 1 if rank <= len(GRASP_COLOURS) else 1 + (rank - 2) % (len(GRASP_COLOURS) - 1)
        label = f"Grasp {rank}" + (", the best" if rank == 1 and len(grasps) > 1 else "")
        detail = f"{grasp.family}, {grasp.accepted}: {quality}"
        canvas.layers.append(
            Layer(f"grasp-{rank}", label, True, GRASP_COLOURS[turn], _note(grasp), detail)
        )
    if len(grasps) > 1:
        together = "instead of one by one"
        canvas.layers.append(Layer("together", "All at once", False, LINK_COLOUR, together))


def draw_motion(
    canvas: Canvas,
    motion: Motion,
    hand: Hand,
    station: Station | None = None,
    surroundings: Surroundings = ALONE,
) -> None:
    """Add the recorded poses of all that moves, for playback on demand."""
    times = motion.times - motion.times[0]
    tracks = [(OBJECT_NODE, _since_the_start(motion))]
    tracks += [
        (free_body_node(number), _since_the_start(motion, beside_body(body.name)))
        for number, body in enumerate(surroundings.free)
        if beside_body(body.name) in motion.poses
    ]
    tracks += [
        (f"{ROOT}/hand/{number}", motion.poses[link])
        for number, link in enumerate(hand.links)
        if link in motion.poses
    ]
    if station is not None:
        tracks += arm_tracks(station, motion, first=len(hand.links))
    canvas.commands.append(drawing.animate(times, tracks))
    canvas.layers.append(Layer("lift", "Lift", True, LINK_COLOUR, "of the true object, simulated"))


def link_poses(hand: Hand, grasp: Grasp, station: Station | None = None) -> list[FloatArray]:
    """Return the poses of the hand's links in O, in the order of `hand.links`, then the arm's."""
    place = {name: k for k, name in enumerate(grasp.joint_names)}
    missing = [name for name in hand.joint_names if name not in place]
    if missing:
        raise InvalidOptionError(
            f"the grasp has no position of joint '{missing[0]}'", option="grasps", value=missing[0]
        )
    q = np.asarray(grasp.joint_positions)[[place[name] for name in hand.joint_names]]
    poses = hand.forward_kinematics(grasp.X_OH, q)
    arm = [] if station is None else arm_poses(station, np.asarray(grasp.X_OH))
    return [poses[link] for link in hand.links] + arm


def touch_facts(
    hand: Hand, touches: Sequence[ProbeOutcome | None], station: Station | None = None
) -> list[dict[str, Any] | None]:
    """Return the link poses in O and the approach direction at each touch, as JSON.

    With a station, also return the arm's poses along the approach, the touch first, and its length.
    """
    facts: list[dict[str, Any] | None] = []
    for touch in touches:
        if touch is None or touch.hand_pose is None:
            facts.append(None)
            continue
        poses = hand.forward_kinematics(touch.hand_pose.X_OH, touch.hand_pose.joint_positions)
        fact: dict[str, Any] = {
            "links": [column_major(poses[link]) for link in hand.links],
            "direction": [round(float(v), 5) for v in touch.probe.direction],
        }
        if station is not None:
            X_OH, direction = touch.hand_pose.X_OH, touch.probe.direction
            distance, frames = arm_approach(station, X_OH, direction)
            fact["arm"] = [[column_major(X) for X in frame] for frame in frames]
            fact["distance"] = round(distance, 5)
        facts.append(fact)
    return facts


def hand_points(hand: Hand, posture: Sequence[FloatArray]) -> FloatArray:
    """Return points on the hand's surface in O, shape (N, 3) [m], for given link poses."""
    return _placed(hand, [surface_points(g.mesh, 150) for g in hand.link_geometries], posture)


def outlines(hand: Hand, postures: Sequence[Sequence[FloatArray]]) -> FloatArray:
    """Return the outermost points of the hand's bodies in O, (N, 3) [m], for several postures."""
    points_G = [outermost(surface_points(g.mesh, 150)) for g in hand.link_geometries]
    return np.vstack([np.empty((0, 3)), *(_placed(hand, points_G, links) for links in postures)])


def _placed(
    hand: Hand, points_G: Sequence[FloatArray], posture: Sequence[FloatArray]
) -> FloatArray:
    """Return the points of all bodies, each (P, 3) in its frame G, in O for given link poses."""
    number = {link: k for k, link in enumerate(hand.links)}
    points = [np.empty((0, 3))]
    for geometry, p_G in zip(hand.link_geometries, points_G, strict=True):
        X_OG = posture[number[geometry.link]] @ geometry.X_LG
        points.append(apply_pose(X_OG, p_G))
    return np.vstack(points)


def moved_points(motion: Motion, hand: Hand, object_points: FloatArray) -> FloatArray:
    """Return the outermost points, shape (N, 3) [m], of object and hand during a motion."""
    ends = np.stack([object_points.min(axis=0), object_points.max(axis=0)])
    outlines = {OBJECT: trimesh.bounds.corners(ends)}
    for geometry in hand.link_geometries:
        X = geometry.X_LG
        corners = apply_pose(X, trimesh.bounds.corners(geometry.mesh.bounds))
        outlines[geometry.link] = np.vstack([outlines.get(geometry.link, corners[:0]), corners])
    moments = np.unique(np.linspace(0, len(motion) - 1, _MOMENTS).astype(int))
    poses = {**motion.poses, OBJECT: _since_the_start(motion)}
    points = [
        apply_pose(X_WB, p_B)
        for body, p_B in outlines.items()
        if body in poses
        for X_WB in poses[body][moments]
    ]
    return outermost(np.vstack(points))


def _since_the_start(motion: Motion, body: str = OBJECT) -> FloatArray:
    """Return a body's motion (T, 4, 4) from its first pose, at which the scene shows it."""
    poses = motion.poses[body]
    return np.asarray(poses @ inverse_pose(poses[0]))


def _note(grasp: Grasp) -> str:
    likely = grasp.quality.get("success_probability")
    epsilon = grasp.quality["epsilon"]
    return f"epsilon {epsilon:.3g}" if likely is None else f"predicted {likely:.0%}"


def hand_page(
    hand: Hand, *, headline: Sequence[tuple[str, str]] = (), summary: Sequence[str] = ()
) -> str:
    """Return an HTML page of a hand, in its base link's frame turned so that the approach is down.

    The axes of H are red (x), green (y) and blue (z); orange marks are the pads with their axes,
    purple marks are the leading spheres of the probe postures.
    """
    canvas = Canvas()
    turn = trimesh.geometry.align_vectors(hand.approach_H, [0.0, 0.0, -1.0])
    X_OH = make_pose(turn[:3, :3])
    postures = [(f"pregrasp {name}", q) for name, q in hand.pregrasps.items()]
    postures += [(f"probe posture {f}", p.joint_positions) for f, p in hand.probe_postures.items()]
    draw_hand(canvas, hand)
    marks = list(_marks(hand))
    for link, name, mesh, colour in marks:
        path = f"{ROOT}/hand/{link}/{name}"
        canvas.commands.append(drawing.draw_mesh(path, mesh, drawing.material(colour)))
    for k, (axis, colour) in enumerate(zip("xyz", AXIS_COLOURS, strict=True)):
        mesh = _bar(X_OH[:3, 3], X_OH[:3, 3] + _AXIS_LENGTH * X_OH[:3, k])
        path = f"{OBJECT_NODE}/frame/{axis}"
        canvas.commands.append(drawing.draw_mesh(path, mesh, drawing.material(colour)))
    poses = []
    for number, (label, q) in enumerate(postures, start=1):
        links = hand.forward_kinematics(X_OH, q)
        poses.append([links[link] for link in hand.links])
        canvas.layers.append(Layer(f"grasp-{number}", label, True, LINK_COLOUR))
    points = np.vstack([hand_points(hand, posture) for posture in poses])
    tips = [apply_pose(X[link], mesh.vertices) for X in poses for link, _, mesh, _ in marks]
    outline = outermost(np.vstack([points, *tips]))
    grid = draw_table(canvas, points, outline, float(points[:, 2].min()) - 0.01)
    story = Story.of(contacts=0, surfaces=[], grasps=len(poses), lift_seconds=0.0)
    story = Story(tuple(replace(chapter, label="Postures") for chapter in story.chapters))
    content = PageContent(
        story,
        CameraView(choose_azimuth(outline[:0], outline), object=outline, hand=outline),
        grasps=poses,
        postures=[label for label, _ in postures],
    )
    title = f"Hand {hand.name}"
    overlay = build_overlay(
        title,
        summary,
        headline=headline,
        layers=canvas.layers,
        scale=None,
        grid=grid,
        story=story,
        postures=True,
    )
    return build_page(title, canvas, overlay=overlay, content=content)


def _marks(hand: Hand) -> Iterator[tuple[int, str, trimesh.Trimesh, str]]:
    """Yield the marks of pads and leading tips: number of the link, name, mesh in L, colour."""
    number = {link: k for k, link in enumerate(hand.links)}
    for pad in hand.pads:
        for part, mesh in enumerate(_pad_marks(pad.center_L, pad.radius, pad.axis_L)):
            yield number[pad.link], f"pad_{pad.finger}_{part}", mesh, PAD_MARK
    for finger, posture in hand.probe_postures.items():
        ball = trimesh.creation.icosphere(subdivisions=2, radius=1.03 * posture.radius)
        ball.apply_translation(posture.center_L)
        yield number[posture.link], f"tip_{finger}", ball, TIP_MARK


def _pad_marks(center: FloatArray, radius: float, axis: FloatArray) -> Iterator[trimesh.Trimesh]:
    ball = trimesh.creation.icosphere(subdivisions=2, radius=1.02 * radius or _MARK)
    yield ball.apply_translation(center)
    start = center + radius * axis
    yield _bar(start, start + 0.02 * axis)


def _bar(start: FloatArray, end: FloatArray) -> trimesh.Trimesh:
    return trimesh.creation.cylinder(_AXIS_RADIUS, segment=[start, end], sections=16)
