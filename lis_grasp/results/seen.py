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
from lis_grasp.results.notes import WARNING
from lis_grasp.views import DepthView, Views, save_view, segment_object
from lis_grasp.views.seen_table import doubt_of_seen_table, require_level_table
from lis_grasp.visualization.view_layers import GUESSED_COLOUR, UNKNOWN_COLOUR, depth_picture

SEEN_CONTACTS, SEEN_PAGE = "contacts.ply", "seen.html"
"""The contacts of a view, and its page."""

# Contacts in the file.
_MOST = 400


@dataclass(frozen=True, slots=True, eq=False)
class SeenObject:
    """What one view shows of an object on a table."""

    view: DepthView  #: with a mask
    contacts: Contacts  #: thinned
    guesses: Contacts  #: implied by the contour
    mask_is_given: bool
    doubt: str = ""  #: of the camera's pose, in words

    @property
    def summary(self) -> tuple[str, ...]:
        """What was understood, what is unknown, and a doubt if there is one, in a line each."""
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
            *([f"{WARNING}{self.doubt}"] if self.doubt else []),
        )


def see(view: DepthView, support_height: float, folder: Path) -> SeenObject:
    """Write what a view shows of an object: view.npz, contacts.ply and a page, seen.html.

    The mask is found above the table at `support_height` [m] if the view has none. Raises
    `NothingSeenError` if nothing stands on the table, or no pixel of it has a depth,
    `InvalidViewError` if the table in the image is not level, and `InvalidFileError` if the folder
    has another program's contacts.ply.
    """
    require_level_table(view, support_height)
    given = view.mask is not None
    masked = view if given else segment_object(view, support_height)
    contacts = Views((masked,), support_height).contacts(_MOST)
    if not len(contacts):
        raise NothingSeenError(
            "the object's pixels have no depth that makes a contact: give another mask, or a view"
            " from another side"
        )
    doubt = doubt_of_seen_table(masked, support_height)
    seen = SeenObject(masked, contacts, masked.guesses(support_height), given, doubt)
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
    picture = base64.b64encode(depth_picture(seen.view, seen.guesses)).decode("ascii")
    return f"""<!DOCTYPE html>
<html lang="en">
<head><meta charset="utf-8"><title>What the camera shows</title>
<style>body {{ font-family: sans-serif; max-width: 60em; margin: 1em auto; }}
img {{ image-rendering: pixelated; width: 100%; }}</style></head>
<body>
<h1>What the camera shows</h1>
{lines}
<p><img src="data:image/png;base64,{picture}" alt="depth image with the object"></p>
<p>Near is bright; the object is in colours;
<b style="color: {GUESSED_COLOUR}">implied by its contour</b>,
<b style="color: {UNKNOWN_COLOUR}">unknown</b>.</p>
<h2>Contacts</h2>
{points_svg(seen.contacts.points, seen.contacts.normals)}
<h2>Implied by the contour: never measured</h2>
{points_svg(seen.guesses.points, seen.guesses.normals)}
</body>
</html>
"""
