"""Everything that code can reach from a record without an import: fields, items and closures."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from collections.abc import Set as AnySet
from functools import partial
from types import FunctionType, MethodType, ModuleType
from typing import Any

import numpy as np

_LEAVES = (str, bytes, int, float, complex, type(None), type, ModuleType)


def reachable(*start: Any) -> Iterator[Any]:
    """Yield the given objects and all that is reachable from them, each once."""
    stack, seen = list(start), set()
    while stack:
        item = stack.pop()
        if isinstance(item, _LEAVES) or id(item) in seen:
            continue
        seen.add(id(item))
        yield item
        stack.extend(_parts(item))


def _parts(item: Any) -> Iterator[Any]:
    match item:
        case np.ndarray():
            yield from item.ravel() if item.dtype == object else ()
        case Mapping():
            yield from (*item.keys(), *item.values())
        case list() | tuple() | AnySet():
            yield from item
        case partial():
            yield from (item.func, *item.args, *item.keywords.values())
        case MethodType():
            yield from (item.__self__, item.__func__)
        case FunctionType():
            yield from (cell.cell_contents for cell in item.__closure__ or ())
            yield from (*(item.__defaults__ or ()), *(item.__kwdefaults__ or {}).values())
    yield getattr(item, "__wrapped__", None)  # of functools.lru_cache
    yield from getattr(item, "__dict__", {}).values()
    for kind in type(item).__mro__:
        slots = vars(kind).get("__slots__", ())
        for name in (slots,) if isinstance(slots, str) else slots:
            yield getattr(item, name, None)
