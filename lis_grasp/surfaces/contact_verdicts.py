"""Verdicts on contacts that contradict each other, and signs of normals that have none."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any, Literal

import numpy as np
import numpy.typing as npt
from scipy.spatial import cKDTree

from lis_grasp.contacts import Contacts
from lis_grasp.exceptions import EstimationError, InvalidContactsError, named_rows, shown
from lis_grasp.records import read_only, short_repr
from lis_grasp.surfaces._contact_noise import noise_of
from lis_grasp.surfaces._contradictions import (
    FLIPPED,
    SOUND,
    STRAY,
    WRONG_NORMAL,
    find_contradictions,
)
from lis_grasp.surfaces._normal_signs import LEAST_MARGIN, likeliest_signs
from lis_grasp.surfaces.contact_preparation import (
    in_free_space_of,
    merge_duplicates,
    repaired,
    with_noise,
)
from lis_grasp.typing import BoolArray, FloatArray, IndexArray
from lis_grasp.underflow import underflows

Verdict = Literal["sound", "flipped", "wrong normal", "stray"]
"""What a contact is, as far as the others show it."""

_CODES: dict[Verdict, int] = {
    "sound": SOUND,
    "flipped": FLIPPED,
    "wrong normal": WRONG_NORMAL,
    "stray": STRAY,
}
# Fraction of the contacts that a viewpoint need not see.
_MOST_UNSEEN = 0.15
# Distance between a contact and a mean of another normal, in extents.
_SAME_NORMAL = 0.01


@dataclass(frozen=True, slots=True, eq=False)
class ContactVerdicts:
    """The verdict on each of N contacts, with its evidence. Made by `judge_contacts`.

    Examples
    --------
    >>> verdicts = judge_contacts(contacts)
    >>> len(verdicts.rows("flipped")), verdicts.sentence()
    (0, '')
    """

    contacts: Contacts  #: as measured
    codes: IndexArray  #: (N,) 0 sound, 1 flipped, 2 wrong normal, 3 stray
    #: (N,) log odds of the likeliest contradiction, less those needed: above 0 for bad contacts
    log_odds: FloatArray

    __repr__ = short_repr

    def rows(self, *verdicts: Verdict) -> IndexArray:
        """Return the rows of contacts with one of these verdicts, counted from 0."""
        return np.flatnonzero(np.isin(self.codes, [_CODES[verdict] for verdict in verdicts]))

    @property
    def bad(self) -> BoolArray:
        """Which contacts are not sound, shape (N,)."""
        return np.asarray(self.codes != SOUND)

    @property
    def credible(self) -> Contacts:
        """The contacts to estimate from: flipped normals turned, wrong ones and strays left out.

        Raises `TooManyBadContactsError` if more than a quarter of the contacts is bad: what is true
        is then unknown.
        """
        return repaired(self.contacts, self.codes)

    def sentence(self) -> str:
        """Return a sentence on turned and omitted contacts, rows counted from 1, or nothing."""
        parts = []
        for name, verdict, done in (
            ("normal", "flipped", "turned"),
            ("contact", "wrong normal", "of wrong normal left out"),
            ("stray contact", "stray", "left out"),
        ):
            rows = self.rows(verdict)  # type: ignore[arg-type]
            if len(rows):
                things = name if len(rows) == 1 else f"{name}s"
                parts.append(f"{len(rows)} {things} {done} ({named_rows(rows)})")
        if not parts:
            return ""
        return (
            f"{' and '.join(parts)} of {len(self.contacts)} contacts, because the others contradict"
            f" {'it' if self.bad.sum() == 1 else 'them'}"
        )

    def facts(self) -> dict[str, list[Any]]:
        """Return the rows that were turned and left out, from 0, and their log odds; or nothing."""
        if not self.bad.any():
            return {}
        turned, left_out = self.rows("flipped"), self.rows("wrong normal", "stray")
        odds = np.round(self.log_odds[np.concatenate([turned, left_out])], 2)
        return {
            "turned": turned.tolist(),
            "left_out": left_out.tolist(),
            "doubt_log_odds": odds.tolist(),
        }


@underflows
def judge_contacts(
    contacts: Contacts, *, position_noise: float | None = None, normal_noise: float | None = None
) -> ContactVerdicts:
    """Find the contacts that contradict all others: flipped or wrong normals, and strays.

    Every estimator does this by itself (`prepare_contacts`). Each contact is predicted from all
    others by the process of `gpis`, and compared as measured, with the other side of its normal,
    and as a stray; the worst is turned or left out, until none is worth it. Free space is evidence:
    it is outside. A contact at (0, 0, 0) exactly is taken for an empty row if it contradicts others
    only a little. More than 160 contacts are judged in groups. Fewer than five are sound; of fewer
    than 20 no contact is left out.

    Parameters
    ----------
    contacts
        At least one, in any frame. All count as sound if they are `Contacts.judged`.
    position_noise, normal_noise
        See `prepare_contacts`.

    Raises
    ------
    InvalidContactsError, InvalidOptionError
        If there is no contact, or a noise is out of range.

    Examples
    --------
    A normal on a ball has the wrong side.

    >>> import numpy as np
    >>> rng = np.random.default_rng(0)
    >>> normals = rng.normal(size=(40, 3))
    >>> normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    >>> points = 0.03 * normals
    >>> normals[7] *= -1.0
    >>> judge_contacts(Contacts(points, normals)).rows("flipped").tolist()
    [7]
    """
    if contacts.judged:
        count = len(contacts)
        return ContactVerdicts(
            contacts, read_only(np.full(count, SOUND)), read_only(np.full(count, -np.inf))
        )
    merged = with_noise(merge_duplicates(contacts, position_noise, normal_noise))
    noise = np.nan_to_num(noise_of(merged, None, None))
    codes, odds = find_contradictions(in_free_space_of(contacts, merged), *noise)
    # Repeated contacts share the verdict of their mean: the nearest in place and normal.
    places = np.hstack([merged.points, _SAME_NORMAL * merged.extent * merged.normals])
    measured = np.hstack([contacts.points, _SAME_NORMAL * merged.extent * contacts.normals])
    _, mean = cKDTree(places).query(measured)
    return ContactVerdicts(contacts, read_only(codes[mean]), read_only(odds[mean]))


@underflows
def orient_normals(
    contacts: Contacts,
    *,
    viewpoint: npt.ArrayLike | None = None,
    position_noise: float | None = None,
    normal_noise: float | None = None,
) -> Contacts:
    """Return contacts whose normals of unknown sign point outward.

    Parameters
    ----------
    contacts
        At least one; the signs of their normals mean nothing.
    viewpoint
        Place of the sensor, shape (3,) [m], or one place for each contact, (N, 3): normals point
        towards it. None for the signs that make all contacts together likeliest.
    position_noise, normal_noise
        See `prepare_contacts`.

    Raises
    ------
    EstimationError
        If the contacts do not show the signs: others are about as likely.
    InvalidContactsError
        If the viewpoint is not one place or one for each contact, or cannot see many of them.

    Examples
    --------
    >>> oriented = orient_normals(contacts, viewpoint=[0.0, 0.0, 1.0])
    >>> bool(((oriented.points[:, 2] < 1.0) == 1).all())
    True
    """
    noise = np.nan_to_num(noise_of(contacts, position_noise, normal_noise))
    likeliest, margin = likeliest_signs(contacts, *noise)
    if viewpoint is not None:
        places = np.asarray(viewpoint, dtype=np.float64)
        if places.shape not in ((3,), contacts.points.shape) or not np.isfinite(places).all():
            raise InvalidContactsError(
                f"viewpoint must be 3 finite numbers, or as many rows of 3 as there are contacts"
                f" ({len(contacts)}); it is {shown(viewpoint)}",
                field="viewpoint",
            )
        towards = np.sum((places - contacts.points) * contacts.normals, axis=1)
        signs = np.where(towards < 0.0, -1.0, 1.0)
        inward = int(np.count_nonzero(signs != likeliest))
        if margin >= LEAST_MARGIN and inward > _MOST_UNSEEN * len(contacts):
            raise InvalidContactsError(
                f"viewpoint must see the contacts: towards it, {inward} of {len(contacts)} normals"
                " point into the object, whose far sides are not seen from there. Let the contacts"
                " show the signs (`normals` unsigned), or give the viewpoint of each contact",
                field="viewpoint",
            )
    else:
        signs = likeliest
        if margin < LEAST_MARGIN:
            raise EstimationError(
                "the contacts do not show on which side of each normal is outside: other sides are"
                " about as likely. Give the place of the sensor (`viewpoint` X Y Z), directions of"
                " approach (columns ax,ay,az), or contacts on more sides"
            )
    return replace(contacts, normals=signs[:, None] * contacts.normals)
