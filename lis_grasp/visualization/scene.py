"""A run as one page: what was touched, what was believed, how it was grasped and lifted."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from html import escape
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import trimesh

from lis_grasp.contacts import Contacts
from lis_grasp.exceptions import InvalidOptionError
from lis_grasp.io.atomic_writing import write_text
from lis_grasp.motion import Motion
from lis_grasp.typing import FloatArray
from lis_grasp.visualization.camera import ELEVATION, choose_azimuth, outermost, surface_points
from lis_grasp.visualization.canvas import Canvas
from lis_grasp.visualization.hand_layers import (
    column_major,
    draw_grasps,
    draw_hand,
    draw_motion,
    hand_points,
    link_poses,
    moved_points,
    touch_facts,
)
from lis_grasp.visualization.object_layers import (
    draw_contacts,
    draw_estimates,
    draw_table,
    draw_truth,
)
from lis_grasp.visualization.overlay import build_overlay
from lis_grasp.visualization.scene_page import build_page
from lis_grasp.visualization.story import Story

if TYPE_CHECKING:
    from lis_grasp.grasping.grasps import Grasp
    from lis_grasp.hands.hand import Hand
    from lis_grasp.visualization.touch_poses import TouchPose


_NOTHING = np.empty((0, 3))
_LEAST_SIZE = 0.01  # [m] of a scene with a single contact


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Scene:
    """What a page shows, as a story that can be played; a notebook shows it in place.

    On its time line contacts come one after the other and the estimate grows, then each candidate
    grasp is shown, then the lift. The page takes what to show from its address: ``#t=2.5`` a moment
    of the time line [s], ``play=1`` plays it, ``layers=`` some of ``estimate``, ``truth``,
    ``contacts``, ``normals``, ``free``, ``hand``, ``grasp-1`` (and so on), ``together``, ``lift``
    with commas between them, ``azimuth``, ``elevation`` [deg] and ``zoom`` the camera, ``panel=0``
    no overlay, ``panel=1`` an unfolded one; parts are joined by ``&``.

    Parameters
    ----------
    truth
        The true object [m], in O; a glass shell over the estimate, solid during the lift.
    estimate
        The estimated surface [m], in O. Its ``vertex_attributes["uncertainty"]``, shape (V,) [m],
        gives the colours; without it, or without any number in it, the surface has one colour.
    contacts
        Where the object was touched, in O, in the order of the touches.
    growth
        Estimates on the way: each with the number of contacts that it is made from, the first ones;
        the numbers increase, and are less than that of all contacts.
    touch_poses
        Where the hand was at each contact, None where that is not known; or nothing at all.
    grasps
        Best first; the first `shown_grasps` can be looked at.
    hand
        The hand of `grasps` and `motion`; needed if there are any.
    motion
        The lift, in the frame O of the object at its start.
    support_height
        Height of the table in O [m]; the lowest point of the object if it is not given.
    title, summary
        Plain text: a heading and the lines below it.
    shown_grasps
        How many grasps the page carries.

    Raises
    ------
    InvalidOptionError
        If there is nothing to show, or grasps or a motion without the hand that they are of, or
        growth that does not lead up to the estimate.
    """

    truth: trimesh.Trimesh | None = None
    estimate: trimesh.Trimesh | None = None
    contacts: Contacts | None = None
    growth: Sequence[tuple[int, trimesh.Trimesh]] = ()
    touch_poses: Sequence[TouchPose | None] = ()
    grasps: Sequence[Grasp] = ()
    hand: Hand | None = None
    motion: Motion | None = None
    support_height: float | None = None
    title: str = "lis_grasp"
    summary: Sequence[str] = ()
    shown_grasps: int = 5

    def __post_init__(self) -> None:
        if not len(self._object_points()):
            raise InvalidOptionError(
                "a scene needs a true object, an estimate or contacts; it has none of them"
            )
        if self.hand is None and (self.grasps or self.touch_poses or self.motion is not None):
            raise InvalidOptionError(
                "touches, grasps and a motion need the hand they are of: give hand"
            )
        if len(self.touch_poses) not in (0, self._contact_count()):
            raise InvalidOptionError(
                f"touch_poses must be one a contact ({self._contact_count()}), or none;"
                f" {len(self.touch_poses)} came"
            )
        for grasp in self.grasps:
            if self.hand is not None and grasp.hand != self.hand.name:
                raise InvalidOptionError(
                    f"a grasp is of the hand '{grasp.hand}', the hand to draw is"
                    f" '{self.hand.name}': load the hand of the grasps"
                )

        counts = [0, *(count for count, _ in self.growth), self._contact_count()]
        if self.growth and (self.estimate is None or np.any(np.diff(counts) <= 0)):
            raise InvalidOptionError(
                "growth must lead up to an estimate, each step from more contacts than the one"
                f" before and from fewer than all {counts[-1]}; it has {counts[1:-1]}"
            )

    def html(self) -> str:
        """Return the scene as one self-contained page; equal scenes are equal bytes."""
        canvas = Canvas()
        object_points = self._object_points()
        size = max(float(np.ptp(object_points, axis=0).max()), _LEAST_SIZE)
        surfaces = list(self.growth)
        if self.estimate is not None:
            surfaces.append((self._contact_count(), self.estimate))
        scale = draw_estimates(canvas, surfaces)
        if self.truth is not None:
            draw_truth(canvas, self.truth)
        if self.contacts is not None:
            draw_contacts(canvas, self.contacts, size)
        lift_seconds, postures, moved = self._draw_hand(canvas, object_points)
        hands = [hand_points(self.hand, p) for p in postures] if self.hand is not None else []
        best = hands[0] if hands else _NOTHING
        around = np.vstack([_NOTHING, *hands])
        story = Story.of(
            contacts=self._contact_count(),
            surfaces=[count for count, mesh in surfaces if len(mesh.faces)],
            grasps=len(postures),
            lift_seconds=lift_seconds,
        )

        drawn = object_points
        if self.estimate is not None:
            drawn = np.vstack([object_points, self.estimate.vertices])
        outline = outermost(np.vstack([drawn, around]))
        lowest = float(object_points[:, 2].min())
        support = lowest if self.support_height is None else self.support_height
        grid = draw_table(canvas, object_points, outline, support)
        facts: Mapping[str, Any] = {
            "layers": [
                {"id": layer.identity, "on": layer.on, "colour": layer.colour, "note": layer.note}
                for layer in canvas.layers
            ],
            "grasps": [[column_major(X) for X in posture] for posture in postures],
            "touching": self._touch_facts(),
            "story": story.facts(),
            "camera": {
                "azimuth": round(float(np.rad2deg(choose_azimuth(object_points, best))), 3),
                "elevation": round(float(np.rad2deg(ELEVATION)), 3),
                "object": _rounded(outermost(drawn)),
                "hand": _rounded(outermost(around)),
                "moved": _rounded(moved),
            },
        }
        overlay = build_overlay(
            self.title,
            self.summary,
            layers=canvas.layers,
            scale=scale,
            grid=grid,
            story=story,
        )
        return build_page(self.title, overlay=overlay, scene=facts, commands=canvas.commands)

    def _repr_html_(self) -> str:
        """Return the scene for a notebook: the same page in a frame, alive without a kernel."""
        return (
            f'<iframe srcdoc="{escape(self.html())}" title="{escape(self.title)}"'
            ' style="width: 100%; height: 640px; border: 0; border-radius: 8px"></iframe>'
        )

    def _object_points(self) -> FloatArray:
        """Return points of what is known best of the object: they give its size and its place."""
        for mesh in (self.truth, self.estimate):
            if mesh is not None and len(mesh.faces):
                return surface_points(mesh)
        return _NOTHING if self.contacts is None else self.contacts.points

    def _contact_count(self) -> int:
        return 0 if self.contacts is None else len(self.contacts)

    def _touch_facts(self) -> dict[str, Any] | None:
        return touch_facts(self.hand, self.touch_poses) if self.hand and self.touch_poses else None

    def _draw_hand(
        self, canvas: Canvas, object_points: FloatArray
    ) -> tuple[float, list[list[FloatArray]], FloatArray]:
        """Draw what the hand does; return the lift's duration, postures and places moved to."""
        shown = tuple(self.grasps)[: self.shown_grasps]
        motion = self.motion if self.motion is not None and self.motion.duration > 0.0 else None
        if self.hand is None or not (shown or self.touch_poses or motion is not None):
            return 0.0, [], _NOTHING
        postures = [link_poses(self.hand, grasp) for grasp in shown]
        draw_hand(canvas, self.hand)
        draw_grasps(canvas, shown)
        if motion is None:
            return 0.0, postures, _NOTHING
        draw_motion(canvas, motion, self.hand)
        moved = moved_points(motion, self.hand, object_points)
        return motion.duration, postures, moved


def write_scene(
    path: Path | str,
    *,
    truth: trimesh.Trimesh | None = None,
    estimate: trimesh.Trimesh | None = None,
    contacts: Contacts | None = None,
    growth: Sequence[tuple[int, trimesh.Trimesh]] = (),
    touch_poses: Sequence[TouchPose | None] = (),
    grasps: Sequence[Grasp] = (),
    hand: Hand | None = None,
    motion: Motion | None = None,
    support_height: float | None = None,
    title: str = "lis_grasp",
    summary: Sequence[str] = (),
    shown_grasps: int = 5,
) -> None:
    """Write a scene as one HTML file that opens offline; the arguments are those of `Scene`.

    Raises
    ------
    InvalidOptionError
        As `Scene` does.
    InvalidFileError
        If the file cannot be written.
    """
    scene = Scene(
        truth=truth,
        estimate=estimate,
        contacts=contacts,
        growth=growth,
        touch_poses=touch_poses,
        grasps=grasps,
        hand=hand,
        motion=motion,
        support_height=support_height,
        title=title,
        summary=summary,
        shown_grasps=shown_grasps,
    )
    write_text(Path(path), scene.html())


# In a notebook the last expression of a cell is shown: `show(truth=..., contacts=...)`.
show = Scene


def _rounded(points: FloatArray) -> list[list[float]]:
    rounded: list[list[float]] = np.round(points, 5).tolist()
    return rounded
