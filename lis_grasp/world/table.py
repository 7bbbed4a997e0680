"""Table under the object, and the bodies on it."""

from __future__ import annotations

from dataclasses import dataclass, replace

from lis_grasp.typing import FloatArray
from lis_grasp.world.surroundings import ALONE, Surroundings


@dataclass(frozen=True, slots=True)
class Table:
    """A table with a flat top, on which the object is; the arm's base is on it or beside it.

    Other bodies may be beside the object.

    Examples
    --------
    >>> table = Table(-0.05)
    >>> table.height, len(table.surroundings)
    (-0.05, 0)
    """

    height: float = 0.0  #: of the top in W [m]
    half_width: float = 0.75  #: along W's x and y from `center` [m]
    center: tuple[float, float] = (0.0, 0.0)  #: x and y in W [m]
    surroundings: Surroundings = ALONE  #: in W, beside the object

    def with_bodies(self, surroundings: Surroundings) -> Table:
        """Return the same table with other bodies on it, or these at other places."""
        return replace(self, surroundings=surroundings)

    def in_frame(self, X_WF: FloatArray) -> Table:
        """Return the same in a frame F of pose `X_WF` (4, 4) in W: it stays level at its height."""
        return self.with_bodies(self.surroundings.in_frame(X_WF))
