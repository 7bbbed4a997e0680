"""Contacts: oriented contact points of an object, with validation, load and save."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field, replace
from html import escape
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt
from scipy.spatial import cKDTree

from lis_grasp.exceptions import InvalidContactsError, require_packages
from lis_grasp.geometry import UNIT_ROUNDING, UNIT_TOLERANCE, apply_pose, inverse_pose, rotate
from lis_grasp.io.contact_files import contact_columns, read_contact_file, write_contact_file
from lis_grasp.io.point_pictures import points_svg
from lis_grasp.io.units import in_metres, require_plausible_size
from lis_grasp.records import ByValue, Record, fields_of, read_only
from lis_grasp.typing import FloatArray

if TYPE_CHECKING:
    import pandas

FARTHEST = 1e7
"""Largest coordinate of a contact [m]; anything larger is in the wrong unit."""

HALF_SPACE = 100.0
"""Radius of balls of free space that stand for half-spaces [m]."""


@dataclass(frozen=True, slots=True, eq=False)
class Contacts(ByValue, Record):
    """Oriented contact points of an object, in its frame O.

    Parameters
    ----------
    points
        Shape (N, 3) [m], on the surface of the object.
    normals
        Shape (N, 3), unit, pointing out of the object.
    forces
        Shape (N,) [N], the measured normal forces, or None.
    fingers
        Names of the fingers in contact, one for each contact, or empty if unknown.
    times
        Shape (N,) [s], of the contacts, or None.
    free_points
        Shape (K, 3) [m]: places that the hand passed through without a contact.
    free_radii
        Shape (K,) [m], of free balls about these points; empty if only the points are free. A
        half-space, such as the space beyond a touched end, is a ball of `HALF_SPACE`.
    position_noise
        Shape (N,) [m], one standard deviation of each contact's position along its normal. NaN
        where it is unknown; None if it is unknown for all.
    normal_noise
        Shape (N,) [rad], one standard deviation of each component of each contact's normal
        perpendicular to it. NaN and None as in `position_noise`.
    judged
        Whether estimators believe all contacts, instead of turning or leaving out those that others
        contradict (`judge_contacts`). It is not part of files.

    Raises
    ------
    InvalidContactsError
        If shapes disagree, a number is not finite (except for NaN in noise), a point is farther
        than `FARTHEST` from the origin, a normal is not of unit length, or a radius or noise is
        negative.

    Examples
    --------
    Contacts are sliced and joined like a sequence; each item is a record of one contact. As
    an array they are rows of point and normal.

    >>> import numpy as np
    >>> axes = np.vstack([np.eye(3), -np.eye(3)])
    >>> contacts = Contacts(points=0.03 * axes, normals=axes)
    >>> contacts[:2] + contacts[5]
    Contacts(3 contacts, extent 0.03 m, spacing 0.04243 m)
    >>> np.asarray(contacts).shape, contacts == contacts[:]
    ((6, 6), True)
    """

    points: FloatArray
    normals: FloatArray
    forces: FloatArray | None = None
    fingers: tuple[str, ...] = ()
    times: FloatArray | None = None
    free_points: FloatArray = field(default_factory=lambda: np.empty((0, 3)))
    free_radii: FloatArray = field(default_factory=lambda: np.empty(0))
    position_noise: FloatArray | None = None
    normal_noise: FloatArray | None = None
    judged: bool = False

    def __post_init__(self) -> None:
        points = _frozen_array("points", self.points, (None, 3))
        count = len(points)
        _require_near("points", points)
        normals = _frozen_array("normals", self.normals, (count, 3))
        with np.errstate(over="ignore"):  # a length that overflows is not 1 either
            lengths = np.linalg.norm(normals, axis=1)  # (N,)
        if np.any(np.abs(lengths - 1.0) > UNIT_TOLERANCE):
            worst = int(np.argmax(np.abs(lengths - 1.0)))
            exchanged = np.allclose(np.linalg.norm(points, axis=1), 1.0, atol=UNIT_TOLERANCE)
            cure = "exchange them with the points" if exchanged else "divide each by its length"
            raise InvalidContactsError(
                f"normals must have unit length; normal {worst} has length {lengths[worst]:.4g}:"
                f" {cure}",
                field="normals",
                row=worst,
            )
        # A unit normal is kept to the last bit, so that saving and loading changes nothing.
        off = np.abs(lengths - 1.0) > UNIT_ROUNDING
        normals = np.where(off[:, None], normals / lengths[:, None], normals)
        object.__setattr__(self, "points", points)
        object.__setattr__(self, "normals", read_only(normals))
        for name in ("forces", "times"):
            values = getattr(self, name)
            if values is not None:
                object.__setattr__(self, name, _frozen_array(name, values, (count,)))
        object.__setattr__(self, "fingers", tuple(self.fingers))
        if not all(isinstance(finger, str) for finger in self.fingers):
            raise InvalidContactsError("fingers must be strings; some are not", field="fingers")
        if self.fingers and len(self.fingers) != count:
            message = f"fingers must be {count} names, or empty; there are {len(self.fingers)}"
            raise InvalidContactsError(message, field="fingers")
        free_points = _frozen_array("free_points", self.free_points, (None, 3))
        _require_near("free_points", free_points)
        object.__setattr__(self, "free_points", free_points)
        object.__setattr__(self, "free_radii", checked_radii(self.free_radii, len(free_points)))
        for name in ("position_noise", "normal_noise"):
            object.__setattr__(self, name, _checked_noise(name, getattr(self, name), count))

    @classmethod
    def empty(cls) -> Contacts:
        """Return a record without contacts, as before the first touch of an object."""
        return cls(np.empty((0, 3)), np.empty((0, 3)))

    def __len__(self) -> int:
        return len(self.points)

    def __array__(self, dtype: npt.DTypeLike | None = None, copy: bool | None = None) -> FloatArray:
        """Return rows of points and normals, shape (N, 6), as numpy asks for them."""
        if copy is False:
            raise ValueError("contacts as an array are a copy: points and normals are arrays")
        return np.hstack([self.points, self.normals]).astype(dtype or np.float64)

    def _repr_html_(self) -> str:
        """Return a small picture of the points with their normals, which a notebook displays."""
        return f"{points_svg(self.points, self.normals)}<br><code>{escape(repr(self))}</code>"

    def to_pandas(self) -> pandas.DataFrame:
        """Return a table with the columns of a contact file: x, y, z, nx, ny, nz and others.

        Free points are not part of it. Raises `InvalidOptionError` if pandas is not installed.
        """
        require_packages("pandas", extra="study", option="to_pandas")
        import pandas

        fingers = {"finger": self.fingers} if self.fingers else {}
        return pandas.DataFrame(contact_columns(fields_of(self)) | fingers)

    def __repr__(self) -> str:
        free = f", {len(self.free_points)} free points" if len(self.free_points) else ""
        size = f"extent {self.extent:.4g} m, spacing {self.spacing:.4g} m"
        return f"Contacts({len(self)} contacts{free}, {size})"

    @property
    def bounds(self) -> FloatArray:
        """Lowest and highest corner of the points, shape (2, 3) [m]."""
        if not len(self):
            raise InvalidContactsError("bounds need at least one contact", field="points")
        return np.array([self.points.min(axis=0), self.points.max(axis=0)])

    @property
    def extent(self) -> float:
        """Largest side of the points' bounding box [m]; 0 for fewer than two contacts."""
        return float(np.ptp(self.points, axis=0).max()) if len(self) else 0.0

    @property
    def spacing(self) -> float:
        """Median distance from a contact to its nearest other one [m]; 0 for fewer than two."""
        distinct = np.unique(self.points, axis=0)
        if len(distinct) < 2:
            return 0.0
        distances, _ = cKDTree(distinct).query(distinct, k=2)
        return float(np.median(distances[:, 1]))

    def __getitem__(self, index: int | slice | npt.ArrayLike) -> Contacts:
        """Return the contacts at `index`, as `subset` does; an integer gives contacts of one."""
        if isinstance(index, (int, np.integer)):
            if not -len(self) <= index < len(self):
                raise IndexError(f"there is no contact {index} of {len(self)}")
            return self.subset([int(index)])
        return self.subset(index)  # type: ignore[arg-type]

    def __iter__(self) -> Iterator[Contacts]:
        """Yield the contacts one by one, each as contacts of one, with all free points."""
        return (self[k] for k in range(len(self)))

    def __add__(self, other: Contacts) -> Contacts:
        """Return these contacts followed by `other`, as `append` does."""
        return self.append(other) if isinstance(other, Contacts) else NotImplemented

    def subset(self, index: npt.ArrayLike) -> Contacts:
        """Return the contacts at `index` (a mask, a slice or integers), with all free points."""
        rows = np.arange(len(self))
        if not isinstance(index, slice):
            index = np.asarray(index)
            index = index if index.size else index.astype(np.intp)  # [] is an array of floats
        chosen = rows[index]
        return Contacts(
            self.points[chosen],
            self.normals[chosen],
            None if self.forces is None else self.forces[chosen],
            tuple(self.fingers[i] for i in chosen) if self.fingers else (),
            None if self.times is None else self.times[chosen],
            self.free_points,
            self.free_radii,
            None if self.position_noise is None else self.position_noise[chosen],
            None if self.normal_noise is None else self.normal_noise[chosen],
            self.judged,
        )

    def in_frame(self, X_OF: npt.ArrayLike) -> Contacts:
        """Return the contacts in a frame F with pose X_OF, (4, 4) or of Drake, in this one."""
        X_FO = inverse_pose(X_OF)
        return replace(
            self,
            points=apply_pose(X_FO, self.points),
            normals=rotate(X_FO, self.normals),
            free_points=apply_pose(X_FO, self.free_points),
        )

    def append(self, other: Contacts) -> Contacts:
        """Return these contacts followed by `other`.

        Forces, times and fingers are kept only if both have them; noise that one of the two lacks
        is unknown for its contacts.
        """
        if not isinstance(other, Contacts):
            raise TypeError(
                f"append takes Contacts; this is of type {type(other).__name__}: write"
                " append(Contacts(points, normals))"
            )
        kept, empty = (self, other) if len(self) else (other, self)
        if not len(empty) and not len(empty.free_points):
            return kept
        free_points = np.vstack([self.free_points, other.free_points])
        free_radii = np.concatenate([self.free_radii, other.free_radii])
        if not len(empty):
            return replace(kept, free_points=free_points, free_radii=free_radii)
        return Contacts(
            np.vstack([self.points, other.points]),
            np.vstack([self.normals, other.normals]),
            _join(self.forces, other.forces),
            self.fingers + other.fingers if self.fingers and other.fingers else (),
            _join(self.times, other.times),
            free_points,
            free_radii,
            _join_noise(self.position_noise, other.position_noise, len(self), len(other)),
            _join_noise(self.normal_noise, other.normal_noise, len(self), len(other)),
            self.judged and other.judged,
        )

    @classmethod
    def load(cls, path: Path | str, *, units: str | None = None) -> Contacts:
        """Read contacts from a file of points with normals; see `io.contact_files`.

        `load_contacts` also reads points without normals, and checks the side of the normals.

        Parameters
        ----------
        path
            The file.
        units
            Its length unit, a key of `shapes.UNITS`; None for what its columns state, or else
            metres.

        Raises
        ------
        InvalidFileError
            If the file is missing, of another format, damaged, or lacks points or normals.
        InvalidContactsError
            If its numbers are not valid contacts, or are too far apart for an object of a hand:
            mistaken units, mostly.
        InvalidOptionError
            If there is no such unit, or the file states another one.
        """
        path = Path(path)
        fields, units = in_metres(path, read_contact_file(path), units)
        try:
            # A touch across an edge makes two contacts, as near to each other as may be.
            require_plausible_size(fields["points"], units, 0.0)
            return cls(**fields)
        except InvalidContactsError as error:
            message = f"{path}: {error}"
            raise InvalidContactsError(message, field=error.field, row=error.row) from None

    def save(self, path: Path | str, *, header: str = "") -> None:
        """Write contacts to a .ply or .csv file; a PLY keeps `header` as comment lines.

        Raises `InvalidFileError` if the path has another ending or cannot be written to.
        """
        fields = {name: value for name, value in fields_of(self).items() if name != "judged"}
        write_contact_file(fields, Path(path), header=header)


def _join(first: FloatArray | None, second: FloatArray | None) -> FloatArray | None:
    return None if first is None or second is None else np.concatenate([first, second])


def _join_noise(
    first: FloatArray | None, second: FloatArray | None, count: int, other_count: int
) -> FloatArray:
    """Return both in a row, NaN for the contacts of the one that is None."""
    return np.concatenate(
        [
            np.full(count, np.nan) if first is None else first,
            np.full(other_count, np.nan) if second is None else second,
        ]
    )


def _checked_noise(name: str, noise: npt.ArrayLike | None, count: int) -> FloatArray | None:
    """Return standard deviations, read-only; None if all are unknown, so that there is one form."""
    if noise is None:
        return None
    array = _frozen_array(name, noise, (count,), allow_nan=True)
    wrong = (array < 0.0) | (array > FARTHEST)
    if wrong.any():
        row = int(np.argmax(wrong))
        raise InvalidContactsError(
            f"{name} must be standard deviations of at least 0, or NaN where unknown; that of"
            f" contact {row} is {array[row]:.4g}",
            field=name,
            row=row,
        )
    return None if np.isnan(array).all() else array


def checked_radii(radii: npt.ArrayLike, count: int) -> FloatArray:
    """Return the radii of `count` balls of free space, read-only; empty `radii` become 0."""
    array = _frozen_array("free_radii", radii if np.size(radii) else np.zeros(count), (count,))
    if np.any((array < 0.0) | (array > FARTHEST)):
        raise InvalidContactsError(
            f"free_radii must be lengths from 0 to {FARTHEST:g} m; the smallest is"
            f" {array.min():.3g}, the largest {array.max():.3g}",
            field="free_radii",
        )
    return array


def _require_near(name: str, points: FloatArray) -> None:
    farthest = float(np.abs(points).max(initial=0.0))
    if farthest > FARTHEST:
        raise InvalidContactsError(
            f"{name} must be in metres, within {FARTHEST:g} m of the origin; one is at"
            f" {farthest:.3g} m: check their unit",
            field=name,
            row=int(np.abs(points).max(axis=1).argmax()),
        )


def _frozen_array(
    name: str, values: npt.ArrayLike, shape: tuple[int | None, ...], *, allow_nan: bool = False
) -> FloatArray:
    try:
        array = np.array(values)
        if array.dtype.kind == "c":
            raise TypeError("there are complex numbers")
        array = array.astype(np.float64)
    except (OverflowError, TypeError, ValueError) as error:
        message = f"{name} must be numbers in rows of equal length: {error}"
        raise InvalidContactsError(message, field=name) from None
    if array.size == 0 and shape[0] is None:
        array = array.reshape(0, 3)
    if array.ndim != len(shape) or any(
        w not in (None, g) for w, g in zip(shape, array.shape, strict=True)
    ):
        wanted = ", ".join("N" if w is None else str(w) for w in shape)
        message = f"{name} must have shape ({wanted}); it has shape {array.shape}"
        if name == "points" and array.ndim == 2 and array.shape[1] == 6:
            message += ": give columns 0 to 2 as points and 3 to 5 as normals"
        raise InvalidContactsError(message, field=name)
    finite = np.isfinite(array) | (allow_nan & np.isnan(array))
    if not finite.all():
        row = int(np.argwhere(~finite)[0, 0])
        message = f"{name} must be finite numbers; row {row} is {array[row]}: remove that row"
        raise InvalidContactsError(message, field=name, row=row)
    return read_only(array)
