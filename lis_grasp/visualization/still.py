"""Still pictures of an estimate with its contacts and a hand at a grasp, as PNG."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt
import trimesh

from lis_grasp.contacts import Contacts
from lis_grasp.typing import FloatArray, IndexArray
from lis_grasp.visualization._arm_layer import link_looks
from lis_grasp.visualization._object_layers import (
    BAD_COLOUR,
    CONTACT_COLOUR,
    FIXED_COLOUR,
    GLASS,
    LOOSE_COLOUR,
    NORMAL_COLOUR,
    PLAIN_ESTIMATE_COLOUR,
    marker_size,
    uncertainty_scale,
)
from lis_grasp.visualization.camera import ELEVATION, View, choose_azimuth
from lis_grasp.visualization.hand_layers import hand_points, link_colour, link_poses
from lis_grasp.visualization.raster import Solid, Window, encode_png, render
from lis_grasp.world import ALONE, Surroundings

if TYPE_CHECKING:
    from lis_grasp.grasping.grasps import Grasp
    from lis_grasp.robots.hand import Hand

PIXELS = (640, 480)
"""Columns and rows of a picture of a folder of results."""

# Sizes in those of the markers: radius of a contact, half width and length of a normal.
_RADIUS, _HALF_WIDTH, _LENGTH = 0.017, 0.004, 0.12
_CORNERS = 12  # of the disc of a contact
_FRONT = 2.5  # radii by which it is in front of the point: oblique surfaces would cut it
LEAST_SIZE = 0.01
"""Size of a scene with a single contact [m]."""
_BESIDE = 0.5  # widths of the shown object and hand, of what a picture shows beside them
_MARGIN = 0.05  # about object and hand, in the object's sizes
_MOST_MARKED = 1000  # contacts; of more, as of a cloud, every n-th is marked
_MOST_POINTS = 2000  # of the object, and of the hand, by which occlusion is measured


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Still:
    """Content of a still picture: a solid with contacts on it, and a hand at a grasp, all in O."""

    solid: trimesh.Trimesh | None = None  #: [m], coloured by its uncertainty if it has one
    contacts: Contacts = field(default_factory=Contacts.empty)
    bad_contacts: Sequence[int] | IndexArray = ()  #: rows of contacts that others contradict
    hand: Hand | None = None
    grasp: Grasp | None = None  #: of the hand
    size: float | None = None  #: of the object [m], for the colours; None for the solid's
    colour: str = PLAIN_ESTIMATE_COLOUR  #: of a solid without uncertainty
    surroundings: Surroundings = ALONE  #: glass, which the picture shows as far as it is near

    def best_view(self) -> View:
        """Return the view at which the hand hides the object least."""
        both = (self._object_points(), self._hand_points())
        few = (points[:: -(-len(points) // _MOST_POINTS) or 1] for points in both)
        return View(choose_azimuth(*few), ELEVATION)

    def window(self, view: View, pixels: tuple[int, int] = PIXELS) -> Window:
        """Return the window that shows the object and the whole hand."""
        place, _ = view.project(self._object_points())
        margin = _MARGIN * max(float(np.ptp(place, axis=0).max()), LEAST_SIZE)
        links = [np.asarray(link.mesh.vertices) for link in self._links()]
        around = np.vstack([place, *(view.project(points)[0] for points in links)])
        low, high = around.min(axis=0) - margin, around.max(axis=0) + margin
        if self.surroundings.mesh is not None:
            beside, _ = view.project(self.surroundings.mesh.vertices)
            most = _BESIDE * (high - low)
            low, high = (
                np.minimum(low, np.maximum(beside.min(axis=0) - margin, low - most)),
                np.maximum(high, np.minimum(beside.max(axis=0) + margin, high + most)),
            )
        wide, tall = high - low
        width = max(float(wide), float(tall) * pixels[0] / pixels[1])
        return Window(view, 0.5 * (low + high), width, pixels)

    def draw(self, window: Window) -> npt.NDArray[np.uint8]:
        """Return the picture as RGBA (rows, columns, 4), transparent where there is nothing."""
        solids = [*self._solids(window.view)]
        picture = render(solids, window)
        if not len(self.surroundings):
            return picture
        bodies = [
            Solid(b.mesh, FIXED_COLOUR if b.is_fixed else LOOSE_COLOUR) for b in self.surroundings
        ]
        return _mixed(picture, render([*solids, *bodies], window), GLASS)

    def png(self, pixels: tuple[int, int] = PIXELS) -> bytes:
        """Return the picture of the best view as PNG; equal contents give equal bytes."""
        return png_of(self.draw(self.window(self.best_view(), pixels)))

    @property
    def _is_hand_alone(self) -> bool:
        return self._mesh is None and not len(self.contacts)

    @property
    def _mesh(self) -> trimesh.Trimesh | None:
        return self.solid if self.solid is not None and len(self.solid.faces) else None

    def _object_points(self) -> FloatArray:
        """Return the mesh's vertices, else the contacts, else those of the grasp, (N, 3) [m]."""
        if self._mesh is not None:
            return np.asarray(self._mesh.vertices)
        points, _ = self._marked()
        return points if len(points) else np.zeros((1, 3))

    def _marked(self) -> tuple[FloatArray, FloatArray]:
        """Return points and normals (N, 3) to mark: the contacts, or those of a grasp alone."""
        if self._is_hand_alone and self.grasp is not None:
            return self.grasp.contact_points, self.grasp.contact_normals
        return self.contacts.points, self.contacts.normals

    def _hand_points(self) -> FloatArray:
        if self.hand is None or self.grasp is None:
            return np.empty((0, 3))
        return hand_points(self.hand, link_poses(self.hand, self.grasp))

    def _solids(self, view: View) -> Iterator[Solid]:
        among = [self._object_points(), *([self._hand_points()] if self._is_hand_alone else [])]
        size = marker_size(np.vstack(among), LEAST_SIZE)
        if self._mesh is not None:
            yield Solid(self._mesh, self._solid_colour(self._mesh))
        points, normals = self._marked()
        few = np.arange(0, len(points), -(-len(points) // _MOST_MARKED) or 1)
        bad = np.isin(few, self.bad_contacts)
        for rows, colour in ((few[~bad], CONTACT_COLOUR), (few[bad], BAD_COLOUR)):
            if len(rows):
                yield Solid(_discs(view, points[rows], _RADIUS * size), colour)
        if len(few):
            yield Solid(_ribbons(view, points[few], normals[few], size), NORMAL_COLOUR)
        yield from self._links()

    def _links(self) -> Iterator[Solid]:
        """Yield the links of the hand at its grasp, if there are both."""
        if self.hand is not None and self.grasp is not None:
            for link, X_OL in zip(self.hand.links, link_poses(self.hand, self.grasp), strict=True):
                for look in link_looks(self.hand, link):
                    yield Solid(look.copy().apply_transform(X_OL), link_colour(self.hand, link))

    def _solid_colour(self, solid: trimesh.Trimesh) -> str | FloatArray:
        scale = uncertainty_scale(solid, self.size or float(solid.extents.max()))
        return (
            self.colour if scale is None else scale.colours(solid.vertex_attributes["uncertainty"])
        )


def _mixed(
    behind: npt.NDArray[np.uint8], front: npt.NDArray[np.uint8], opacity: float
) -> npt.NDArray[np.uint8]:
    """Return a picture RGBA (rows, columns, 4) with so much of another in front of it."""
    alphas = [(1.0 - opacity) * behind[..., 3:] / 255.0, opacity * front[..., 3:] / 255.0]
    alpha = alphas[0] + alphas[1]
    colours = (alphas[0] * behind[..., :3] + alphas[1] * front[..., :3]) / np.maximum(alpha, 1e-9)
    return np.round(np.concatenate([colours, 255.0 * alpha], axis=-1)).astype(np.uint8)


def png_of(picture: npt.NDArray[np.uint8]) -> bytes:
    """Return a picture (rows, columns, 4) on white as PNG."""
    opacity = picture[..., 3:] / 255.0
    on_white = np.round(opacity * picture[..., :3] + 255.0 * (1.0 - opacity)).astype(np.uint8)
    return encode_png(on_white)


def _discs(view: View, points: FloatArray, radius: float) -> trimesh.Trimesh:
    """Return a disc that faces the eye, in front of each point (N, 3) [m]."""
    turn = 2.0 * np.pi * np.arange(_CORNERS) / _CORNERS
    front = np.full(_CORNERS, _FRONT)
    rim = radius * np.column_stack([np.cos(turn), np.sin(turn), front]) @ view.axes
    fan = np.column_stack([np.zeros(_CORNERS - 2), *np.arange(1, _CORNERS - 1) + [[0], [1]]])
    return _copies(points[:, None] + rim, fan.astype(int))


def _ribbons(view: View, points: FloatArray, normals: FloatArray, size: float) -> trimesh.Trimesh:
    """Return a ribbon that faces the eye along each normal (N, 3), from its point (N, 3) [m]."""
    side = np.cross(view.axes[2], normals)
    side *= _HALF_WIDTH * size / np.maximum(np.linalg.norm(side, axis=1), 1e-9)[:, None]
    ends = points + _LENGTH * size * normals
    corners = np.stack([points - side, ends - side, ends + side, points + side], axis=1)
    return _copies(corners, np.array([[0, 1, 2], [0, 2, 3]]))


def _copies(corners: FloatArray, faces: npt.NDArray[np.int64]) -> trimesh.Trimesh:
    """Return N copies of flat faces (F, 3) of K corners, whose places are (N, K, 3) [m]."""
    number, many = corners.shape[:2]
    index = faces + many * np.arange(number)[:, None, None]
    return trimesh.Trimesh(corners.reshape(-1, 3), index.reshape(-1, 3), process=False)
