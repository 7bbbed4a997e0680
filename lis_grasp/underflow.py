"""Underflow to 0 in kernels and weights, which is right whatever the user's program raises on."""

from __future__ import annotations

from collections.abc import Callable
from functools import wraps
from types import FunctionType
from typing import ParamSpec, TypeVar

import numpy as np

_Class = TypeVar("_Class", bound=type)
_Arguments = ParamSpec("_Arguments")
_Result = TypeVar("_Result")


def underflows(function: Callable[_Arguments, _Result]) -> Callable[_Arguments, _Result]:
    """Decorate a function in which tiny numbers become 0, as they should.

    NumPy ignores that by itself, but not in a program with ``np.seterr(under="raise")`` or
    ``np.seterr(all="raise")``.

    >>> with np.errstate(all="raise"):
    ...     underflows(np.exp)(-1e4)
    np.float64(0.0)
    """

    @wraps(function)
    def ignoring(*args: _Arguments.args, **kwargs: _Arguments.kwargs) -> _Result:
        with np.errstate(under="ignore"):
            return function(*args, **kwargs)

    return ignoring


def methods_underflow(cls: _Class) -> _Class:
    """Decorate the public methods of a class as `underflows` does a function."""
    for name, member in list(vars(cls).items()):
        if name.startswith("_"):
            continue
        if isinstance(member, FunctionType):
            setattr(cls, name, underflows(member))
        elif isinstance(member, classmethod):
            setattr(cls, name, classmethod(underflows(member.__func__)))
    return cls
