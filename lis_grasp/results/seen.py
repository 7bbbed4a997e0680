"""A depth view as understood: its files, and a page of what is seen, implied and unknown."""

from __future__ import annotations

import base64
from dataclasses import dataclass
from html import escape
from pathlib import Path

import numpy as np

from lis_grasp.contacts import Contacts
from lis_grasp.exceptions import NothingSeenError
from lis_grasp.io import provenance
from lis_grasp.io.atomic_writing import write_text
from lis_grasp.io.point_pictures import points_svg
from lis_grasp.results.folder import VIEW, require_own
from lis_grasp.typing import ByteArray, FloatArray
from lis_grasp.views import DepthView, Views, save_view, segment_object
from lis_grasp.visualization.raster import encode_png

SEEN_CONTACTS, SEEN_PAGE = "contacts.ply", "seen.html"
"""The contacts of a view, and its page."""

# Contacts in the file.
_MOST = 400
# Colours of a picture: object, implied contour, unknown; and the object's part of a pixel's colour.
_OBJECT, _IMPLIED, _UNKNOWN, _TINT = (38, 130, 142), (242, 145, 44), (200, 60, 160), 0.45
# Pixels about the object that are shown, and how large each is.
_MARGIN, _ZOOM = 40, 3


@dataclass(frozen=True, slots=True, eq=False)
class SeenObject:
    """What one view shows of an object on a table."""

    view: DepthView  #: with a mask
    contacts: Contacts  #: thinned
    guesses: Contacts  #: implied by the contour
    mask_is_given: bool

    @property
    def summary(self) -> tuple[str, str]:
        """What was understood, and what is unknown, in a line each."""
        points = self.view.contacts.points
        middle = ", ".join(f"{x:.3f}" for x in 0.5 * (points.min(axis=0) + points.max(axis=0)))
        source = "as given" if self.mask_is_given else "found above the table"
        pixels = np.count_nonzero(self.view.object_mask)
        holes = self.view.unknown & self.view.object_mask
        unknown = 100.0 * np.count_nonzero(holes) / pixels
        noise = 1e3 * float(np.median(self.contacts.position_noise))  # type: ignore[arg-type]
        return (
            f"object at ({middle}) m: {pixels} pixels, mask {source}; {len(self.contacts)} contacts"
            f" of {noise:.2g} mm",
            f"unknown: {unknown:.0f} % of its pixels have no depth; its contour implies"
            f" {len(self.guesses)} weak contacts of the side that is not seen",
        )


def see(view: DepthView, support_height: float, folder: Path) -> SeenObject:
    """Write what a view shows of an object: view.npz, contacts.ply and a page, seen.html.

    The mask is found above the table at `support_height` [m] if the view has none. Raises
    `NothingSeenError` if nothing stands on the table, or no pixel of it has a depth, and
    `InvalidFileError` if the folder has another program's contacts.ply.
    """
    given = view.mask is not None
    masked = view if given else segment_object(view, support_height)
    contacts = Views((masked,), support_height).contacts(_MOST)
    if not len(contacts):
        raise NothingSeenError(
            "the object's pixels have no depth that makes a contact: give another mask, or a view"
            " from another side"
        )
    seen = SeenObject(masked, contacts, masked.guesses(support_height), given)
    require_own(folder / SEEN_CONTACTS)
    folder.mkdir(parents=True, exist_ok=True)
    save_view(masked, folder / VIEW)
    header = provenance.describe(source="view", view=VIEW)
    contacts.save(folder / SEEN_CONTACTS, header=header)
    write_text(folder / SEEN_PAGE, page_of(seen))
    return seen


def page_of(seen: SeenObject) -> str:
    """Return a page with the image, and with contacts and implied contacts side by side."""
    lines = "".join(f"<p>{escape(line)}</p>" for line in seen.summary)
    picture = base64.b64encode(encode_png(picture_of(seen))).decode("ascii")
    return f"""<!DOCTYPE html>
<html lang="en">
<head><meta charset="utf-8"><title>What the camera shows</title>
<style>body {{ font-family: sans-serif; max-width: 60em; margin: 1em auto; }}
img {{ image-rendering: pixelated; max-width: 100%; }}</style></head>
<body>
<h1>What the camera shows</h1>
{lines}
<p><img src="data:image/png;base64,{picture}" alt="depth image with the object"></p>
<p>Depth in grey; <b style="color: rgb{_OBJECT}">object</b>,
<b style="color: rgb{_IMPLIED}">implied by its contour</b>,
<b style="color: rgb{_UNKNOWN}">unknown</b>.</p>
<h2>Contacts</h2>
{points_svg(seen.contacts.points, seen.contacts.normals)}
<h2>Implied by the contour: never measured</h2>
{points_svg(seen.guesses.points, seen.guesses.normals)}
</body>
</html>
"""


def picture_of(seen: SeenObject) -> ByteArray:
    """Return the part of the depth image about the object in colours, (H, W, 3)."""
    view = seen.view
    rows, columns = np.nonzero(view.object_mask)
    low = np.maximum([rows.min() - _MARGIN, columns.min() - _MARGIN], 0)
    part = (
        slice(low[0], rows.max() + _MARGIN + 1),
        slice(low[1], columns.max() + _MARGIN + 1),
    )
    depth = view.depth[part]
    known = np.isfinite(depth)
    near, far = np.quantile(depth[known], (0.01, 0.99)) if known.any() else (0.0, 1.0)
    shade = 230.0 - 180.0 * np.clip((depth - near) / max(far - near, 1e-6), 0.0, 1.0)
    colours = np.repeat(np.where(known, shade, 50.0)[..., None], 3, axis=2)
    mask = view.object_mask[part]
    colours[mask] = (1.0 - _TINT) * colours[mask] + _TINT * np.array(_OBJECT)
    colours[view.unknown[part]] = _UNKNOWN
    _mark(colours, view, seen.guesses.points, low)
    large = np.repeat(np.repeat(colours, _ZOOM, axis=0), _ZOOM, axis=1)
    return np.rint(large).astype(np.uint8)


def _mark(colours: FloatArray, view: DepthView, points: FloatArray, low: FloatArray) -> None:
    """Colour the pixels of points (P, 3) in W, in place."""
    u, v, _ = np.round(view.project(points)).astype(np.intp).T
    v, u = v - low[0], u - low[1]
    inside = (v >= 0) & (v < colours.shape[0]) & (u >= 0) & (u < colours.shape[1])
    colours[v[inside], u[inside]] = _IMPLIED
