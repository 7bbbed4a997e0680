"""Helpers of records: copies, read-only arrays, subsets, texts, and pickling."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import fields
from types import MappingProxyType
from typing import Any, TypeVar

import numpy as np

from lis_grasp.guesses import Answering

# Entries of an array that are shown; of longer ones the shape is.
_SHOWN = 4

_Array = TypeVar("_Array", bound="np.ndarray[Any, Any]")
_Record = TypeVar("_Record")
_Key = TypeVar("_Key")
_Value = TypeVar("_Value")


class Record(Answering):
    """Base of frozen records that travel: a copy of one, deep or shallow, is the record itself."""

    __slots__ = ()

    def __copy__(self: _Record) -> _Record:
        return self

    def __deepcopy__(self: _Record, memo: dict[int, Any]) -> _Record:
        return self


class ByValue:
    """Base of records that are equal if all their fields are: arrays number by number, NaN to NaN.

    It compares exactly; `numpy.allclose` of a field compares within a tolerance.
    """

    __slots__ = ()

    def __eq__(self, other: object) -> bool:
        if self is other:
            return True
        if type(self) is not type(other):
            return NotImplemented
        mine, others = fields_of(self), fields_of(other)
        return all(_are_equal(mine[name], others[name]) for name in mine)

    def __hash__(self) -> int:
        arrays = (v.tobytes() for v in fields_of(self).values() if isinstance(v, np.ndarray))
        return hash((type(self), *arrays))


def _are_equal(first: Any, second: Any) -> bool:
    if isinstance(first, np.ndarray) and isinstance(second, np.ndarray):
        return np.array_equal(first, second, equal_nan=first.dtype.kind == "f")
    return type(first) is type(second) and bool(first == second)


class FrozenArrays(Answering):
    """Base of frozen dataclasses whose arrays are read-only, those in mappings too."""

    __slots__ = ()

    def __post_init__(self) -> None:
        for value in fields_of(self).values():
            for array in value.values() if isinstance(value, Mapping) else (value,):
                if isinstance(array, np.ndarray):
                    array.flags.writeable = False


class FrozenDict(dict[_Key, _Value]):
    """A dictionary that is not changed; unlike a mapping proxy, `asdict` and pickle take it."""

    __slots__ = ()

    def _refuse(self, *_: object, **__: object) -> Any:
        raise TypeError("this dictionary is read-only: change dict(...) of it, a copy")

    __setitem__ = __delitem__ = __ior__ = _refuse
    clear = pop = popitem = setdefault = update = _refuse

    def __reduce__(self) -> tuple[type, tuple[dict[_Key, _Value]]]:
        return type(self), (dict(self),)


def read_only(array: _Array) -> _Array:
    """Make an array read-only and return it."""
    array.flags.writeable = False
    return array


def subset_of(record: _Record, index: Any) -> _Record:
    """Return a dataclass of arrays with each array indexed along its first dimension.

    A field that is None stays None.
    """
    arrays = (getattr(record, item.name) for item in fields(record))  # type: ignore[arg-type]
    return type(record)(*(None if array is None else array[index] for array in arrays))


def fields_of(record: Any) -> dict[str, Any]:
    """Return the fields of a dataclass by name, without copying them."""
    return {item.name: getattr(record, item.name) for item in fields(record)}


def short_repr(record: Any) -> str:
    """Return the value of `__repr__` for a dataclass of arrays: one line, shapes for contents."""
    public = {n: v for n, v in fields_of(record).items() if not n.startswith("_")}
    parts = [f"{name}={_short(value)}" for name, value in public.items()]
    return f"{type(record).__name__}({', '.join(parts)})"


def _short(value: Any) -> str:
    match value:
        case np.ndarray() if value.size > _SHOWN or value.ndim > 1:
            return f"array{value.shape}"
        case np.ndarray():
            return f"[{', '.join(_short(item) for item in value.tolist())}]"
        case float():
            return f"{value:.4g}"
        case None | bool() | int() | str():
            return repr(value)
        case Mapping():
            return f"{{{', '.join(f'{key}: {_short(item)}' for key, item in value.items())}}}"
        case tuple() | list():
            return f"{len(value)} {type(value[0]).__name__}" if value else "()"
        case _:
            return type(value).__name__


def reduce_record(record: Any) -> tuple[type, tuple[Any, ...]]:
    """Return the value of `__reduce__` for a dataclass with read-only mappings.

    These cannot be pickled: the other process makes new ones from dictionaries.
    """
    values = fields_of(record).values()
    plain = (dict(value) if isinstance(value, MappingProxyType) else value for value in values)
    return type(record), tuple(plain)
