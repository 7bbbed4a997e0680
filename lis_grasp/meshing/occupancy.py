"""Nodes of a coarse grid that are inside of an estimate."""

from __future__ import annotations

import numpy as np
from scipy import ndimage

from lis_grasp.meshing._band import sample_near_surface
from lis_grasp.meshing._grid import Field, Grid
from lis_grasp.surfaces.implicit_surface import ImplicitSurface
from lis_grasp.typing import BoolArray, FloatArray

# Side of a coarse cell, in cells: wider ones lose sheets as thin as a cell.
_COARSE = 2


def occupied_nodes(
    surface: ImplicitSurface, bounds: FloatArray, cell: float
) -> tuple[FloatArray, BoolArray]:
    """Return the lowest node, (3,) [m], of a grid, and which nodes are inside, (X, Y, Z).

    The grid has cubic cells of side `cell` [m], and covers the box `bounds`, (2, 3) [m], from its
    lowest to its highest corner. Nodes outside of the box are outside of the object, and cavities
    are filled. Few nodes are evaluated far from the surface.
    """
    grid = Grid.cover(bounds, cell, multiple=_COARSE)
    values = sample_near_surface(Field(surface), grid, _COARSE)
    # What was not evaluated is on the side of what surrounds it.
    return grid.origin, np.asarray(ndimage.binary_fill_holes(values < 0.0))
