"""Helpers of records: read-only arrays, subsets, and pickling of read-only mappings."""

from __future__ import annotations

from dataclasses import fields
from types import MappingProxyType
from typing import Any, TypeVar

import numpy as np

_Array = TypeVar("_Array", bound="np.ndarray[Any, Any]")
_Record = TypeVar("_Record")


def read_only(array: _Array) -> _Array:
    """Make an array read-only and return it."""
    array.flags.writeable = False
    return array


def subset_of(record: _Record, index: Any) -> _Record:
    """Return a dataclass of arrays with each array indexed along its first dimension."""
    return type(record)(*(getattr(record, item.name)[index] for item in fields(record)))  # type: ignore[arg-type]


def fields_of(record: Any) -> dict[str, Any]:
    """Return the fields of a dataclass by name, without copying them."""
    return {item.name: getattr(record, item.name) for item in fields(record)}


def reduce_record(record: Any) -> tuple[type, tuple[Any, ...]]:
    """Return the value of `__reduce__` for a dataclass with read-only mappings.

    These cannot be pickled: the other process makes new ones from dictionaries.
    """
    values = fields_of(record).values()
    plain = (dict(value) if isinstance(value, MappingProxyType) else value for value in values)
    return type(record), tuple(plain)
