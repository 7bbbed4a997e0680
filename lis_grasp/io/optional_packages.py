"""Imports of optional packages, with an error that names the extra to install."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from importlib.util import find_spec

from lis_grasp.exceptions import InvalidOptionError


@contextmanager
def needed_package(name: str, extra: str, *, option: str = "") -> Iterator[None]:
    """Turn a failed import into an InvalidOptionError; `extra` is one of this package."""
    try:
        yield
    except ImportError:
        raise _missing(name, extra, option) from None


def require_packages(*names: str, extra: str, option: str = "") -> None:
    """Raise the error of `needed_package` for the first package that is not installed."""
    for name in names:
        if find_spec(name) is None:
            raise _missing(name, extra, option)


def _missing(name: str, extra: str, option: str) -> InvalidOptionError:
    return InvalidOptionError(
        f"{option or 'this'} needs {name}, which is not installed: pip install"
        f" 'lis-grasp[{extra}]', or in a clone: bash bootstrap.sh {extra}",
        option=option,
    )
