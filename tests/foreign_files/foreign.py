"""Outcome of reading a file that another program wrote: right, refused, or wrong."""

from __future__ import annotations

import warnings
from collections.abc import Callable
from typing import Any, Literal

from lis_grasp.exceptions import InvalidInputError, LisGraspWarning

Outcome = Literal["right", "refused", "noted", "wrong"]
"""Noted is a wrong result with a note; wrong is one without."""


def outcome_of(read: Callable[[], Any], is_right: Callable[[Any], bool]) -> Outcome:
    """Return what became of a file."""
    with warnings.catch_warnings(record=True) as notes:
        warnings.simplefilter("always")
        try:
            result = read()
        except InvalidInputError:
            return "refused"
    if is_right(result):
        return "right"
    return "noted" if any(issubclass(n.category, LisGraspWarning) for n in notes) else "wrong"
