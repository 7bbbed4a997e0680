"""What is known of an object beforehand: where it is, how large, and how finely to touch it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from lis_grasp.exceptions import InvalidOptionError
from lis_grasp.exploration.zero_set import sample_zero_set
from lis_grasp.surfaces import ImplicitSurface
from lis_grasp.typing import FloatArray

STEP_FRACTION = 0.25
"""Length of a step in sizes of the object: 50 mm on 20 cm (Ottenhaus et al. 2016, IV.B)."""

# An estimate is searched in a grid this fine, and beyond the object's known size by this share.
_CELLS_PER_STEP, _MARGIN = 4.0, 0.05


@dataclass(frozen=True, slots=True, eq=False)
class Workspace:
    """Where an object is and how large; nothing of its shape.

    Parameters
    ----------
    step
        Distance between touches [m]; a surface is explored within a step of a contact.
    center
        Shape (3,) [m], in O: the middle of the object's box.
    size
        Largest extent of the object [m].
    support_height
        Height in O of the table that it stands on [m]; None for an object that is held, and can be
        touched from below.

    Raises
    ------
    InvalidOptionError
        If a length is not positive or the centre is not three finite numbers.
    """

    step: float
    center: FloatArray
    size: float
    support_height: float | None = None

    def __post_init__(self) -> None:
        for name in ("step", "size"):
            value = getattr(self, name)
            if not (np.isfinite(value) and value > 0.0):
                raise InvalidOptionError(f"{name} must be a positive length [m]; it is {value}")
        center = np.array(self.center, dtype=np.float64)
        if center.shape != (3,) or not np.isfinite(center).all():
            raise InvalidOptionError(f"center must be 3 finite numbers; it is {self.center}")
        center.flags.writeable = False
        object.__setattr__(self, "center", center)

    @property
    def radius(self) -> float:
        """Radius of the ball about the centre that holds all of the object [m]."""
        return 0.5 * float(np.sqrt(3.0)) * self.size

    def way_in(self, points: FloatArray, directions: FloatArray) -> FloatArray:
        """Return how far back along directions each point is outside of the object's ball [m].

        Parameters
        ----------
        points, directions
            Shapes (..., 3) [m] and (..., 3), unit. 0 for lines that miss the ball or end before it.
        """
        offsets = points - self.center
        along = np.sum(offsets * directions, axis=-1)
        inside = self.radius**2 - np.sum(offsets * offsets, axis=-1) + along**2
        return np.where(
            inside > 0.0, np.maximum(along + np.sqrt(np.maximum(inside, 0.0)), 0.0), 0.0
        )

    def sample(
        self, surface: ImplicitSurface, *, rng: np.random.Generator | None = None
    ) -> tuple[FloatArray, FloatArray]:
        """Return points and unit outward normals of an estimate in here, shapes (P, 3).

        A quarter of a step apart. With `rng`, the grid lies differently each time, which keeps its
        pattern out of the touches.
        """
        cell = self.step / _CELLS_PER_STEP
        half = (0.5 + _MARGIN) * self.size
        shift = 0.0 if rng is None else cell * rng.random(3)
        low = self.center - half - shift
        return sample_zero_set(surface, np.array([low, self.center + half]), cell)
