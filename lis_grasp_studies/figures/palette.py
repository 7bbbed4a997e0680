"""Colours of all figures and display names of the estimators.

Estimators take the colours of Okabe and Ito (2008), which are distinct in every common form of
colour blindness. The ends of a scale also differ in lightness, or a length or number shows them.
"""

from __future__ import annotations

from collections.abc import Mapping
from types import MappingProxyType

import numpy as np
import numpy.typing as npt
from matplotlib.colors import LinearSegmentedColormap, to_rgba

from lis_grasp.typing import FloatArray

INK = "#262626"
QUIET = "#8a8a8a"
FAINT = "#ececec"
"""Text and axes; secondary lines; grids."""

ESTIMATORS: Mapping[str, tuple[str, str]] = MappingProxyType(
    {
        "gpis": ("#e69f00", "GPIS"),
        "gpis_rbf": ("#a86b00", "GPIS, RBF"),
        "gpis_thin_plate": ("#d8c62f", "GPIS, thin plate"),
        "lis": ("#0072b2", "LIS"),
        "lis_no_beta": ("#8cb8d9", "LIS, β = 1"),
        "lis_as_published": ("#cc79a7", "LIS, eq. 10 as published"),
        "smooth": ("#d55e00", "smooth"),
        "patch": ("#56b4e9", "patch"),
        "blend": ("#009e73", "blend"),
        "hermite_rbf": ("#7a7a7a", "Hermite RBF"),
        "offset_rbf": ("#b5b5b5", "offset RBF"),
        "truth": ("#262626", "the true mesh"),
    }
)
"""Colour and display name of each estimator, by its short name."""

SURFACE = "#dcdfe4"
BEYOND = "#f4f1ea"
TRUTH = "#cfe3ee"
CONTACT, BAD = "#12355b", "#8e44ad"
EDGE = "#3c4148"
"""An estimate; its unexplored part; a true object; contacts; sharp edges."""

EXPLORED, UNEXPLORED = "#f2d43d", "#c8452f"
"""The yellow and the red of fig. 7."""

INSIDE_OUTSIDE = LinearSegmentedColormap.from_list(
    "inside_outside", ["#54278f", "#9e8ac8", "#dcd7ec", "#fbf8f3", "#fbd9b0", "#ee9c45", "#b35806"]
)
"""Implicit shape potential: violet inside, orange outside, white on the surface."""

CONVEX_CONCAVE = LinearSegmentedColormap.from_list(
    "convex_concave", ["#0b4ea2", "#5b9bd5", "#f7f7f7", "#ee7f6d", "#b3121d"]
)
"""beta*: blue at -1 (convex), red at +1 (concave), white at 0 (flat)."""

SMALL_LARGE = LinearSegmentedColormap.from_list(
    "small_large", ["#28a878", "#b9cf4f", "#f3cf3a", "#ea7f2b", "#c62828", "#7f0d1f"]
)
"""Errors: green is small, red is large; darker towards the large end."""


def estimator_colour(name: str) -> str:
    """Return an estimator's colour; grey for one that has none of its own."""
    return ESTIMATORS.get(name, (QUIET, name))[0]


def estimator_label(name: str) -> str:
    """Return an estimator's display name; its short name if it has none."""
    return ESTIMATORS.get(name, (QUIET, name))[1]


def convexity_colours(values: npt.ArrayLike) -> FloatArray:
    """Return RGBA of beta*, any shape, in [-1, 1]: blue below 0 (convex), red above (concave)."""
    beta = np.asarray(values, dtype=np.float64)
    return np.asarray(CONVEX_CONCAVE(0.5 + 0.5 * np.clip(beta, -1.0, 1.0)), dtype=np.float64)


def error_colours(errors: npt.ArrayLike, largest: float) -> FloatArray:
    """Return RGBA of errors [m], any shape: green at 0, dark red from `largest` on."""
    relative = np.clip(np.asarray(errors, dtype=np.float64) / largest, 0.0, 1.0)
    return np.asarray(SMALL_LARGE(relative), dtype=np.float64)


def rgba(colour: str, opacity: float = 1.0) -> FloatArray:
    """Return a named or ``#rrggbb`` colour as RGBA, shape (4,)."""
    return np.array(to_rgba(colour, opacity))
