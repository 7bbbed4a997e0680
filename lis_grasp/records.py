"""Records with read-only mappings, on their way to other processes."""

from __future__ import annotations

from dataclasses import fields
from types import MappingProxyType
from typing import Any


def reduce_record(record: Any) -> tuple[type, tuple[Any, ...]]:
    """Return what `__reduce__` of a dataclass shall, where some fields are read-only mappings.

    These cannot be pickled: the other process makes new ones of dictionaries.
    """
    values = (getattr(record, item.name) for item in fields(record))
    plain = (dict(value) if isinstance(value, MappingProxyType) else value for value in values)
    return type(record), tuple(plain)
