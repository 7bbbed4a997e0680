"""The table that an image shows, against the given pose of its camera and the table's height."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from lis_grasp.exceptions import InvalidViewError
from lis_grasp.geometry import angle_between, inverse_pose, rotate
from lis_grasp.typing import FloatArray
from lis_grasp.views.depth_view import DepthView
from lis_grasp.views.object_mask import FEWEST, LOWEST, table_in_image

# The table leans at most so much in the frame of the table [rad]; else the pose is another's.
_LEVEL = np.deg2rad(10.0)
# Deviations of the pose's prior that explain where the table is seen.
_DEVIATIONS = 3.0

_INVERTED = (
    "the pose looks inverted, as that of the table in the frame of the camera: its inverse"
    " makes the table level"
)


@dataclass(frozen=True, slots=True, eq=False)
class SeenTable:
    """The plane through the table's pixels, in the frame W that the camera's pose gives."""

    normal: FloatArray  #: (3,), unit, towards the camera
    offset: float  #: of the plane along it [m]

    @classmethod
    def of(cls, view: DepthView, support_height: float) -> SeenTable:
        """Return the plane that an image shows near a height in W [m].

        Raises `InvalidViewError` if it shows no table there.
        """
        inverse = table_in_image(view, support_height)
        rays = view.intrinsics.rays(inverse.shape)
        corners = np.ix_([0, -1], [0, -1])
        # Points p of a plane in C have m p = 1: so does m times a ray the inverse depth.
        m = np.linalg.lstsq(rays[corners].reshape(-1, 3), inverse[corners].ravel(), rcond=None)[0]
        length = float(np.linalg.norm(m))
        normal = rotate(view.X_WC, -m / length)
        return cls(normal, float(normal @ view.X_WC[:3, 3]) - 1.0 / length)

    @property
    def lean(self) -> float:
        """Angle between the table and a level one below the camera [rad]."""
        return float(angle_between(self.normal, np.array([0.0, 0.0, 1.0])))

    def height(self, place: FloatArray) -> float:
        """Return its height [m] in W at the foot of a place (3,)."""
        foot = place - (place @ self.normal - self.offset) * self.normal
        return float(foot[2])


def require_level_table(view: DepthView, support_height: float) -> None:
    """Raise `InvalidViewError` if the table of an image is not level, or not below the camera.

    Its message says whether the inverse of the camera's pose would make it so. Without a table
    nothing is required, if the object's pixels are given.
    """
    try:
        lean = SeenTable.of(_beside(view), support_height).lean
    except InvalidViewError as no_table:
        if _is_level(view.posed(inverse_pose(view.X_WC)), support_height):
            raise InvalidViewError(f"{no_table}; {_INVERTED}", field="X_WC") from None
        if view.mask is None:
            raise
        return
    if lean <= _LEVEL:
        return
    inverted = _is_level(view.posed(inverse_pose(view.X_WC)), support_height)
    advice = _INVERTED if inverted else "give the pose of the camera in the frame of the table"
    raise InvalidViewError(
        f"the table in the image leans by {np.rad2deg(lean):.0f} deg in the frame of the table:"
        f" {advice} (x to the right, y down, z forward)",
        field="X_WC",
    )


def doubt_of_seen_table(view: DepthView, support_height: float) -> str:
    """Return how far the seen table is from its height beside the object; empty if explained.

    The prior of the error of the camera's pose explains three of its deviations there. The view has
    a mask; other pixels of which none is of the table are a doubt, too.
    """
    contacts = view.contacts
    if not len(contacts):
        return ""
    try:
        table = SeenTable.of(_beside(view), support_height)
    except InvalidViewError as no_table:
        others = np.isfinite(view.depth) & ~view.object_mask
        return str(no_table) if np.count_nonzero(others) >= FEWEST else ""
    place = contacts.points.mean(axis=0)
    apart = table.height(place) - support_height
    turn, shift = view.hand_eye.deviations[[0, 3]]
    away = float(np.linalg.norm((place - view.X_WC[:3, 3])[:2]))
    explained = max(LOWEST, _DEVIATIONS * float(np.hypot(shift, turn * away)))
    if abs(apart) <= explained:
        return ""
    return (
        f"the table in the image is {1e3 * abs(apart):.0f} mm {'above' if apart > 0 else 'below'}"
        f" its height of {1e3 * support_height:g} mm, and the error of the camera's pose explains"
        f" {1e3 * explained:.0f} mm: measure the pose again, correct the height by"
        " `support`, or give the pose's error by `hand_eye`"
    )


def _is_level(view: DepthView, support_height: float) -> bool:
    try:
        return SeenTable.of(_beside(view), support_height).lean <= _LEVEL
    except InvalidViewError:
        return False


def _beside(view: DepthView) -> DepthView:
    """Return a view without the object's pixels, if they are known: its faces are planes, too."""
    if view.mask is None:
        return view
    return replace(view, depth=np.where(view.mask, np.nan, view.depth), mask=None)
