"""Imports of optional packages, with an error that names the extra to install."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager

from lis_grasp.exceptions import InvalidOptionError


@contextmanager
def needed_package(name: str, extra: str, *, option: str = "") -> Iterator[None]:
    """Turn a failed import into an InvalidOptionError; `extra` is one of this package."""
    try:
        yield
    except ImportError:
        raise InvalidOptionError(
            f"{option or 'this'} needs {name}, which is not installed: pip install"
            f" 'lis-grasp[{extra}]'",
            option=option,
        ) from None
