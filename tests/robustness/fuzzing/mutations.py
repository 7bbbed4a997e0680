"""Mutations of bytes, XML trees, and plain values of YAML and JSON."""

from __future__ import annotations

import copy
import re
import xml.etree.ElementTree as ET
from collections.abc import Callable, Iterator
from typing import Any

import numpy as np

Generator = np.random.Generator

_NUMBER = re.compile(rb"-?\d+\.?\d*(?:[eE][-+]?\d+)?")
NUMBERS = (
    *("0", "-0.0", "1", "-1", "2", "255", "-2147483648", "2147483648", "99999999999999999999"),
    *("1e-300", "1e300", "1e999", "-1e999", "5e-324", "nan", "inf", "-inf", "NaN", "Infinity"),
    *(".nan", ".inf", "0x10", "1_000", "1,5", "1e", "--1", "", "abc", "9" * 5000, "2001-99-99"),
)


def damage_bytes(rng: Generator, content: bytes) -> tuple[bytes, str]:
    """Return content with one to three mutations, and their names."""
    faults = []
    for name in rng.choice(list(_BYTES), size=rng.choice([1, 1, 1, 2, 3])):
        content = _BYTES[name](rng, content)
        faults.append(str(name))
    return content, ", ".join(faults)


def _spot(rng: Generator, content: bytes) -> int:
    """Return a random place; half of the time near the beginning, where headers are."""
    largest = len(content) + 1
    return int(rng.integers(min(largest, 400) if rng.random() < 0.5 else largest))


def _part(rng: Generator, content: bytes) -> bytes:
    start = _spot(rng, content)
    return content[start : start + int(10.0 ** rng.uniform(0, 3))]


def _flip(rng: Generator, content: bytes) -> bytes:
    changed = bytearray(content)
    for _ in range(int(rng.integers(1, 9)) if changed else 0):
        changed[min(_spot(rng, content), len(changed) - 1)] ^= 1 << int(rng.integers(8))
    return bytes(changed)


def _overwrite(rng: Generator, content: bytes) -> bytes:
    start, length = _spot(rng, content), int(rng.integers(1, 17))
    filler = bytes([int(rng.choice([0, 255, 32, 48, 127]))]) * length
    return content[:start] + filler + content[start + length :]


def _truncate(rng: Generator, content: bytes) -> bytes:
    return content[: _spot(rng, content)]


def _insert(rng: Generator, content: bytes) -> bytes:
    start = _spot(rng, content)
    return content[:start] + rng.bytes(int(rng.integers(1, 33))) + content[start:]


def _delete(rng: Generator, content: bytes) -> bytes:
    start = _spot(rng, content)
    return content[:start] + content[start + int(10.0 ** rng.uniform(0, 3)) :]


def _splice(rng: Generator, content: bytes) -> bytes:
    start = _spot(rng, content)
    return content[:start] + _part(rng, content) + content[start:]


def _swap_number(rng: Generator, content: bytes) -> bytes:
    found = list(_NUMBER.finditer(content[:20000]))
    if not found:
        return content
    # Half of the time a number of the header.
    match = found[int(rng.integers(min(len(found), 12) if rng.random() < 0.5 else len(found)))]
    number = str(rng.choice(NUMBERS)).encode()
    return content[: match.start()] + number + content[match.end() :]


def _swap_line(rng: Generator, content: bytes) -> bytes:
    lines = content.splitlines(keepends=True)
    if not lines:
        return content
    first, second = rng.integers(min(len(lines), 40), size=2)
    lines[first] = lines[second]
    return b"".join(lines)


def _deepen(rng: Generator, content: bytes) -> bytes:
    start = _spot(rng, content)
    pair = [b"[", b"{", b'{"a":', b"<a>", b"- ", b"(", b"&a [*a,"][rng.integers(7)]
    return content[:start] + pair * int(rng.choice([3, 2000, 100_000])) + content[start:]


def _recode(rng: Generator, content: bytes) -> bytes:
    """Encode as UTF-16, add a byte order mark, or change the line ends."""
    draw = rng.integers(4)
    if draw == 0:
        return content.decode("latin-1").encode("utf-16")
    if draw == 1:
        return b"\xef\xbb\xbf" + content
    return content.replace(b"\n", b"\r\n" if draw == 2 else b"\r")


_BYTES: dict[str, Callable[[Generator, bytes], bytes]] = {
    "flipped bits": _flip,
    "overwritten": _overwrite,
    "truncated": _truncate,
    "inserted": _insert,
    "deleted": _delete,
    "spliced": _splice,
    "another number": _swap_number,
    "another line": _swap_line,
    "deep": _deepen,
    "recoded": _recode,
}

PLAIN: tuple[Any, ...] = (
    *(None, True, False, 0, -1, 1, 2**70, 10**400, -0.0, 1e308, 5e-324, float("nan")),
    *(float("inf"), "", "x", "1", "nan", "../../../../etc/passwd", "a\nb", [], [[]], {}, {"a": 1}),
    *([1, 2], [0, 0, 0], ["x"], {1: 2}, {"x": None}),
)


def damage_plain(rng: Generator, content: Any) -> tuple[Any, str]:
    """Return a copy of a tree of plain values with one to three changes, and their names."""
    content, faults = copy.deepcopy(content), []
    for _ in range(int(rng.choice([1, 1, 1, 2, 3]))):
        places = list(_places(content))
        if not places:
            break
        holder, key = places[rng.integers(len(places))]
        draw = rng.integers(5)
        if draw == 0:
            del holder[key]
            faults.append(f"no {key}")
        elif draw == 1:
            other, there = places[rng.integers(len(places))]
            holder[key] = copy.deepcopy(other[there])
            faults.append(f"{key} is {there}")
        elif draw == 2 and isinstance(holder, dict):
            holder[f"{key}x"] = holder.pop(key)
            faults.append(f"{key} misspelt")
        else:
            holder[key] = copy.deepcopy(PLAIN[rng.integers(len(PLAIN))])
            faults.append(f"{key} is {str(holder[key])[:20]!r}")
    return content, ", ".join(faults)


def _places(content: Any) -> Iterator[tuple[Any, Any]]:
    """Yield the container and key of each value in nested mappings and lists."""
    keys = list(content) if isinstance(content, dict) else []
    keys = list(range(len(content))) if isinstance(content, list) else keys
    for key in keys:
        yield content, key
        yield from _places(content[key])


def damage_xml(rng: Generator, text: str) -> tuple[str, str]:
    """Return XML with one to three changed elements or attributes, and the changes' names."""
    root, faults = ET.fromstring(text), []
    for _ in range(int(rng.choice([1, 1, 1, 2, 3]))):
        elements = list(root.iter())
        element = elements[rng.integers(len(elements))]
        parents = {child: parent for parent in elements for child in parent}
        draw = rng.integers(6)
        if draw == 0 and element in parents:
            parents[element].remove(element)
            faults.append(f"no {element.tag}")
        elif draw == 1 and element in parents:
            parents[element].append(copy.deepcopy(element))
            faults.append(f"{element.tag} twice")
        elif draw == 2 and element in parents:
            element.tag = str(elements[rng.integers(len(elements))].tag)
            faults.append(f"something as {element.tag}")
        elif draw == 3 and element in parents:
            other = elements[rng.integers(len(elements))]
            other.append(copy.deepcopy(element))
            faults.append(f"{element.tag} in {other.tag}")
        else:
            faults.append(_damage_values(rng, element))
    return ET.tostring(root, encoding="unicode"), ", ".join(faults)


def _damage_values(rng: Generator, element: ET.Element) -> str:
    """Change an attribute, or the text of an element without any."""
    keys = list(element.attrib)
    if not keys:
        element.text = _other_value(rng, element.text or "")
        return f"{element.tag} is {element.text[:20]!r}"
    key = keys[rng.integers(len(keys))]
    if rng.random() < 0.2:
        del element.attrib[key]
        return f"no {key} of {element.tag}"
    if rng.random() < 0.2:
        other = keys[rng.integers(len(keys))]
        element.attrib[key], element.attrib[other] = element.attrib[other], element.attrib[key]
        return f"{key} and {other} of {element.tag} swapped"
    element.set(key, _other_value(rng, element.get(key, "")))
    return f"{key} of {element.tag} is {element.get(key, '')[:20]!r}"


def _other_value(rng: Generator, value: str) -> str:
    """Change one word of a value, drop one, or write another."""
    words = value.split()
    if words and rng.random() < 0.7:
        place = rng.integers(len(words))
        words[place : place + 1] = [str(rng.choice(NUMBERS))] if rng.random() < 0.8 else []
        return " ".join(words)
    return str(rng.choice([*NUMBERS, "../../../../etc/passwd", "revolute", "floating", "0 0 0"]))
