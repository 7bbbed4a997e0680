"""Scene page of a run: contacts, estimates, grasps and the lift as one HTML file."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import trimesh

from lis_grasp.contacts import Contacts
from lis_grasp.exceptions import InvalidOptionError
from lis_grasp.guesses import Answering
from lis_grasp.io.atomic_writing import write_text
from lis_grasp.motion import Motion
from lis_grasp.records import short_repr
from lis_grasp.typing import FloatArray
from lis_grasp.visualization._arm_layer import arm_points, draw_pedestal, standing_points
from lis_grasp.visualization._drawing import Canvas
from lis_grasp.visualization._object_layers import (
    PLAIN_ESTIMATE_COLOUR,
    TRUTH_COLOUR,
    draw_bad_contacts,
    draw_contacts,
    draw_estimates,
    draw_pose_track,
    draw_search,
    draw_surroundings,
    draw_table,
    draw_truth,
    marker_size,
)
from lis_grasp.visualization._page import PageContent, build_overlay, build_page
from lis_grasp.visualization._story import Story
from lis_grasp.visualization.camera import CameraView, choose_azimuth, outermost, surface_points
from lis_grasp.visualization.hand_layers import (
    draw_grasps,
    draw_hand,
    draw_motion,
    hand_points,
    link_poses,
    moved_points,
    outlines,
    touch_facts,
)
from lis_grasp.visualization.notebook import framed
from lis_grasp.visualization.still import LEAST_SIZE, Still
from lis_grasp.visualization.view_layers import SeenSurface, depth_picture, draw_seen
from lis_grasp.world import ALONE, Surroundings

if TYPE_CHECKING:
    from lis_grasp.arms.station import Station
    from lis_grasp.exploration import LoggedProbe, ProbeOutcome, Region
    from lis_grasp.grasping.grasps import Grasp
    from lis_grasp.robots.hand import Hand


_SHOWN_GRASPS = 5


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Scene(Answering):
    """Content of a scene page, shown on a time line that can be played; a notebook displays it.

    The fragment of the page's address sets the view, such as ``#t=2.5&play=1``: the time [s],
    whether it plays, ``layers`` (a comma-separated list of ``estimate``, ``truth``, ``contacts``,
    ``normals``, ``free``, ``seen``, ``guessed``, ``unknown``, ``search``, ``motion``, ``hand``,
    ``grasp-1`` and so on, ``together``, ``lift``, ``surroundings``, ``free-bodies``), ``azimuth``,
    ``elevation`` [deg], ``zoom``, and ``panel``: 0 hides the overlay, 1 unfolds and ``fold`` folds
    it.

    Parameters
    ----------
    truth
        The true object [m], in O; a glass shell around the estimate, solid in the lift.
    estimate
        The estimated surface [m], in O, coloured by its ``vertex_attributes["uncertainty"]``,
        shape (V,) [m], if it has one, on a scale that depends on the object's size only.
    contacts
        Contacts in O, in the order of the touches.
    bad_contacts
        Rows of contacts that others contradict, which get a colour of their own.
    growth
        Earlier estimates, each with its number of contacts, which increases.
    touches
        The probe outcome that made each contact, None where it is unknown; or empty.
    grasps
        Candidate grasps, the best first; five are shown.
    hand
        The hand of `touches`, `grasps` and `motion`.
    motion
        The lift, in the frame O of the object at its start.
    station
        The arm that carries the hand, in O.
    support_height
        Height of the table in O [m]; None for the lowest point of the object.
    surroundings
        The bodies beside the object, in O, where they are last.
    region, search
        The region that contained the object, on the table z = 0, and the outcomes of the search up
        to the first contact.
    moved
        The logged probes of an exploration that moved the object.
    seen
        What a camera saw before the first touch; None without one.
    title, headline, summary
        Plain text: a heading, numbers with what they are, and lines that are folded below them.

    Raises
    ------
    InvalidOptionError
        If there is nothing to show, the hand is missing or is not the grasps' hand, or `touches` or
        `growth` do not match the contacts.

    Examples
    --------
    >>> scene = Scene(estimate=shapes.find("box").mesh, contacts=contacts)
    >>> scene.save("scene.html")  # for a browser
    """

    truth: trimesh.Trimesh | None = None
    estimate: trimesh.Trimesh | None = None
    contacts: Contacts = field(default_factory=Contacts.empty)
    bad_contacts: Sequence[int] = ()
    growth: Sequence[tuple[int, trimesh.Trimesh]] = ()
    touches: Sequence[ProbeOutcome | None] = ()
    grasps: Sequence[Grasp] = ()
    hand: Hand | None = None
    motion: Motion | None = None
    station: Station | None = None
    support_height: float | None = None
    surroundings: Surroundings = ALONE
    region: Region | None = None
    search: Sequence[ProbeOutcome] = ()
    moved: Sequence[LoggedProbe] = ()
    seen: SeenSurface | None = None
    title: str = "lis_grasp"
    headline: Sequence[tuple[str, str]] = ()
    summary: Sequence[str] = ()

    def __post_init__(self) -> None:
        contacts = len(self.contacts)
        if not len(self._object_points()):
            raise InvalidOptionError(
                "a scene needs a true object, an estimate or contacts; it has none of them"
            )
        if self.hand is None and (self.grasps or self.touches or self.motion is not None):
            raise InvalidOptionError(
                "touches, grasps and a motion need their hand; it is missing", option="hand"
            )
        if len(self.touches) not in (0, contacts):
            raise InvalidOptionError.out_of_range(
                "the number of touches", len(self.touches), f"0 or that of contacts, {contacts}"
            )
        for grasp in self.grasps:
            if self.hand is not None and grasp.hand != self.hand.name:
                raise InvalidOptionError(
                    f"the grasps are for hand '{grasp.hand}'; the scene has '{self.hand.name}'",
                    option="hand",
                    value=self.hand.name,
                )
        counts = [0, *(count for count, _ in self.growth), contacts]
        if self.estimate is None:
            counts[-1] += 1  # the last may be from all contacts
        if self.growth and np.any(np.diff(counts) <= 0):
            raise InvalidOptionError(
                "the growth of an estimate needs numbers of contacts that increase and stay below"
                f" {counts[-1]}; it has {counts[1:-1]}",
                option="growth",
                value=counts[1:-1],
            )

    def save(self, path: Path | str) -> None:
        """Write the scene as one HTML file that opens offline.

        Raises `InvalidFileError` if the file cannot be written.
        """
        write_text(Path(path), self.html())

    def html(self) -> str:
        """Return the scene as one self-contained HTML page."""
        canvas, object_points, size = Canvas(), self._object_points(), self._size()
        surfaces = list(self.growth)
        if self.estimate is not None:
            surfaces.append((len(self.contacts), self.estimate))
        scale = draw_estimates(canvas, surfaces, size)
        if self.truth is not None:
            draw_truth(canvas, self.truth)
        draw_surroundings(canvas, self.surroundings)
        draw_contacts(canvas, self.contacts, marker_size(object_points, LEAST_SIZE))
        if self.seen is not None:
            draw_seen(canvas, self.seen, self.contacts, self.estimate, size)
        bad = self.contacts.subset(list(self.bad_contacts))
        draw_bad_contacts(canvas, bad, marker_size(object_points, LEAST_SIZE))
        if self.region is not None:
            draw_search(canvas, self.region, self.search)
        draw_pose_track(canvas, self.moved, object_points.mean(axis=0))
        shown = self._draw_hand(canvas, object_points)
        story = Story.of(
            contacts=len(self.contacts),
            surfaces=[count for count, mesh in surfaces if len(mesh.faces)],
            grasps=len(shown.postures),
            planned=len(self.grasps),
            lift_seconds=shown.lift_seconds,
        )
        parts = [object_points, *([] if self.estimate is None else [self.estimate.vertices])]
        drawn = outermost(np.vstack(parts))
        around = np.vstack([drawn, shown.around, shown.standing])
        grid = self._draw_table(canvas, object_points, around)
        before = np.vstack([shown.best, shown.standing])  # a growing estimate must not turn it
        looked_at = object_points if self.truth is not None or len(before) else before
        azimuth = choose_azimuth(looked_at, before)
        content = PageContent(
            story,
            CameraView(azimuth, drawn, shown.around, shown.moved, shown.standing),
            grasps=shown.postures,
            touches=shown.touches,
        )
        overlay = build_overlay(
            self.title,
            self.summary,
            headline=self.headline,
            layers=canvas.layers,
            scale=scale,
            grid=grid,
            story=story,
            planned=len(self.grasps),
            picture=None if self.seen is None else depth_picture(self.seen.view, self.seen.guesses),
        )
        return build_page(self.title, canvas, overlay=overlay, content=content)

    def png(self) -> bytes:
        """Return a picture, 640 x 480: estimate, contacts, bodies, best grasp; else the truth."""
        is_known = self.estimate is not None or len(self.contacts) > 0
        return Still(
            solid=self.estimate if is_known else self.truth,
            contacts=self.contacts,
            bad_contacts=self.bad_contacts,
            hand=self.hand,
            grasp=self.grasps[0] if self.grasps else None,
            size=self._size(),
            colour=PLAIN_ESTIMATE_COLOUR if is_known else TRUTH_COLOUR,
            surroundings=self.surroundings,
        ).png()

    __repr__ = short_repr
    _repr_png_ = png  # where no script runs, as on a page of a code host

    def _repr_html_(self) -> str:
        """Return the page in a frame, which a notebook displays without a running kernel."""
        return framed(self.html(), self.title)

    def _object_points(self) -> FloatArray:
        """Return points of the true object, else of the estimate, else the contacts, (N, 3) [m]."""
        for mesh in (self.truth, self.estimate):
            if mesh is not None and len(mesh.faces):
                return surface_points(mesh)
        return self.contacts.points

    def _size(self) -> float:
        """Return the object's largest extent [m], by which colours are scaled."""
        return max(float(np.ptp(self._object_points(), axis=0).max()), LEAST_SIZE)

    def _draw_table(self, canvas: Canvas, object_points: FloatArray, drawn: FloatArray) -> float:
        """Draw the table below everything, points (N, 3) [m]; return its grid's spacing [m]."""
        support_height = self.support_height
        if support_height is None:
            support_height = float(object_points[:, 2].min())
        outline = outermost(drawn)
        if self.region is not None:
            outline = np.vstack([outline, self.region.bounds])
        outline = np.vstack([outline, *(body.mesh.bounds for body in self.surroundings)])
        return draw_table(canvas, object_points, outline, support_height)

    def _draw_hand(self, canvas: Canvas, object_points: FloatArray) -> _ShownHand:
        """Draw the hand and its arm, at grasps and in the lift."""
        grasps, station = tuple(self.grasps)[:_SHOWN_GRASPS], self.station
        motion = self.motion if self.motion is not None and self.motion.duration > 0.0 else None
        if self.hand is None or not (grasps or self.touches or motion is not None):
            return _ShownHand()
        postures = [link_poses(self.hand, grasp, station) for grasp in grasps]
        touches = touch_facts(self.hand, self.touches, station)
        draw_hand(canvas, self.hand, station)
        if station is not None:
            draw_pedestal(canvas, station)
        draw_grasps(canvas, grasps)
        best = around = moved = standing = _no_points()
        if motion is not None:
            draw_motion(canvas, motion, self.hand, station, self.surroundings)
            moved = moved_points(motion, self.hand, object_points)
        if postures:
            best = hand_points(self.hand, postures[0])
            around = outermost(outlines(self.hand, postures))
        if station is not None:
            standing = outermost(standing_points(station))
            if motion is not None:
                moved = outermost(np.vstack([moved, arm_points(station, motion)]))
        return _ShownHand(
            0.0 if motion is None else motion.duration,
            postures,
            touches,
            best=best,
            around=around,
            standing=standing,
            moved=moved,
        )


def _no_points() -> FloatArray:
    return np.empty((0, 3))


@dataclass(frozen=True, slots=True, eq=False)
class _ShownHand:
    """Poses of the hand and its arm on the page, and points (N, 3) [m] that frame the camera."""

    lift_seconds: float = 0.0
    postures: Sequence[list[FloatArray]] = ()  # poses of all links at the shown grasps
    touches: Sequence[dict[str, Any] | None] = ()
    best: FloatArray = field(default_factory=_no_points)  # of the best grasp
    around: FloatArray = field(default_factory=_no_points)  # of all grasps
    standing: FloatArray = field(default_factory=_no_points)  # of the arm at home
    moved: FloatArray = field(default_factory=_no_points)  # in the lift
