"""Hypothesis strategies of damage: bytes, XML, and the plain values of YAML and JSON."""

from __future__ import annotations

import copy
import json
import re
import xml.etree.ElementTree as ET
from collections.abc import Callable, Iterator
from typing import Any

import yaml
from hypothesis import strategies as st

Draw = Callable[[st.SearchStrategy[Any]], Any]

_NUMBER = re.compile(rb"-?\d+\.?\d*(?:[eE][-+]?\d+)?")
NUMBERS = (
    *("0", "-0.0", "1", "-1", "2", "255", "-2147483648", "2147483648", "99999999999999999999"),
    *("1e-300", "1e300", "1e999", "-1e999", "5e-324", "nan", "inf", "-inf", "NaN", "Infinity"),
    *(".nan", ".inf", "0x10", "1_000", "1,5", "1e", "--1", "", "abc", "9" * 5000, "2001-99-99"),
)
PLAIN: tuple[Any, ...] = (
    *(None, True, False, 0, -1, 1, 2**70, 10**400, -0.0, 1e308, 5e-324, float("nan")),
    *(float("inf"), "", "x", "1", "nan", "../../../../etc/passwd", "a\nb", [], [[]], {}, {"a": 1}),
    *([1, 2], [0, 0, 0], ["x"], {1: 2}, {"x": None}),
)
_NESTS = (b"[", b"{", b'{"a":', b"<a>", b"- ", b"(", b"&a [*a,")


@st.composite
def damaged(draw: Draw, content: bytes, ending: str) -> bytes:
    """Draw one to three changes of a file: of its bytes, or of its values if it has a tree."""
    change = damage_bytes
    if ending in _TREES and draw(st.booleans()):
        change = _TREES[ending]
    for _ in range(draw(st.sampled_from([1, 1, 1, 2, 3]))):
        try:
            content = change(draw, content)
        except (ValueError, IndexError, ET.ParseError, yaml.YAMLError, RecursionError):
            break  # changes before this one left no tree, or an empty one
    return content


def damage_bytes(draw: Draw, content: bytes) -> bytes:
    """Draw one change of bytes."""
    return _BYTES[draw(st.sampled_from(sorted(_BYTES)))](draw, content)


def _spot(draw: Draw, content: bytes) -> int:
    """Draw a place; half of the time near the beginning, where headers are."""
    most = min(len(content), 400) if draw(st.booleans()) else len(content)
    return int(draw(st.integers(0, most)))


def _replace(draw: Draw, content: bytes, filler: bytes, removed: int) -> bytes:
    start = _spot(draw, content)
    return content[:start] + filler + content[start + removed :]


def _flip(draw: Draw, content: bytes) -> bytes:
    changed = bytearray(content or b"\0")
    for bit in draw(st.lists(st.integers(0, 7), min_size=1, max_size=8)):
        changed[min(_spot(draw, content), len(changed) - 1)] ^= 1 << bit
    return bytes(changed)


def _overwrite(draw: Draw, content: bytes) -> bytes:
    filler = bytes([draw(st.sampled_from([0, 255, 32, 48, 127]))]) * draw(st.integers(1, 16))
    return _replace(draw, content, filler, len(filler))


def _splice(draw: Draw, content: bytes) -> bytes:
    start = _spot(draw, content)
    return _replace(draw, content, content[start : start + draw(st.integers(1, 1000))], 0)


def _swap_number(draw: Draw, content: bytes) -> bytes:
    numbers = list(_NUMBER.finditer(content[:20000]))
    # Half of the time a number of the header.
    most = min(len(numbers), 12) if draw(st.booleans()) else len(numbers)
    match = numbers[draw(st.integers(0, max(0, most - 1)))]
    other = draw(st.sampled_from(NUMBERS)).encode()
    return content[: match.start()] + other + content[match.end() :]


def _swap_line(draw: Draw, content: bytes) -> bytes:
    lines = content.splitlines(keepends=True)
    rows = st.integers(0, max(0, min(len(lines), 40) - 1))
    lines[draw(rows)] = lines[draw(rows)]
    return b"".join(lines)


def _deepen(draw: Draw, content: bytes) -> bytes:
    pair = draw(st.sampled_from(_NESTS))
    return _replace(draw, content, pair * draw(st.sampled_from([3, 2000, 100_000])), 0)


def _recode(draw: Draw, content: bytes) -> bytes:
    """Encode as UTF-16, add a byte order mark, or change the line ends."""
    return draw(
        st.sampled_from(
            [
                content.decode("latin-1").encode("utf-16"),
                b"\xef\xbb\xbf" + content,
                content.replace(b"\n", b"\r\n"),
                content.replace(b"\n", b"\r"),
            ]
        )
    )


_BYTES: dict[str, Callable[[Draw, bytes], bytes]] = {
    "flipped bits": _flip,
    "overwritten": _overwrite,
    "truncated": lambda draw, content: content[: _spot(draw, content)],
    "inserted": lambda draw, c: _replace(draw, c, draw(st.binary(min_size=1, max_size=32)), 0),
    "deleted": lambda draw, c: _replace(draw, c, b"", draw(st.integers(1, 1000))),
    "spliced": _splice,
    "another number": _swap_number,
    "another line": _swap_line,
    "deep": _deepen,
    "recoded": _recode,
}


def damage_plain(draw: Draw, content: Any) -> Any:
    """Draw one change of a tree of plain values."""
    content = copy.deepcopy(content)
    if not (places := list(_places(content))):
        raise IndexError("an empty tree")
    holder, key = places[draw(st.integers(0, len(places) - 1))]
    way = draw(st.sampled_from(["drop", "copy", "misspell", "replace", "replace"]))
    if way == "drop":
        del holder[key]
    elif way == "copy":
        other, there = places[draw(st.integers(0, len(places) - 1))]
        holder[key] = copy.deepcopy(other[there])
    elif way == "misspell" and isinstance(holder, dict):
        holder[f"{key}x"] = holder.pop(key)
    else:
        holder[key] = copy.deepcopy(draw(st.sampled_from(PLAIN)))
    return content


def _places(content: Any) -> Iterator[tuple[Any, Any]]:
    """Yield the container and key of each value in nested mappings and lists."""
    keys = list(content) if isinstance(content, dict) else []
    keys = list(range(len(content))) if isinstance(content, list) else keys
    for key in keys:
        yield content, key
        yield from _places(content[key])


def _yaml(draw: Draw, content: bytes) -> bytes:
    changed = damage_plain(draw, yaml.safe_load(content))
    return yaml.safe_dump(changed, allow_unicode=True).encode()


def _json(draw: Draw, content: bytes) -> bytes:
    return json.dumps(damage_plain(draw, json.loads(content))).encode()


def _json_lines(draw: Draw, content: bytes) -> bytes:
    lines = content.splitlines(keepends=True)
    row = draw(st.integers(0, len(lines) - 1))
    lines[row] = _json(draw, lines[row]) + b"\n"
    return b"".join(lines)


def _xml(draw: Draw, content: bytes) -> bytes:
    """Draw an element removed, repeated, renamed or moved, or a changed attribute or text."""
    root = ET.fromstring(content)
    elements = list(root.iter())
    some = st.integers(0, len(elements) - 1)
    element, other = elements[draw(some)], elements[draw(some)]
    parent = next((e for e in elements if element in list(e)), None)
    way = draw(st.sampled_from(["remove", "repeat", "rename", "nest", "value", "value"]))
    if way == "value" or parent is None:
        _change_value(draw, element)
    elif way == "remove":
        parent.remove(element)
    elif way == "rename":
        element.tag = other.tag
    else:
        (parent if way == "repeat" else other).append(copy.deepcopy(element))
    return ET.tostring(root)


def _change_value(draw: Draw, element: ET.Element) -> None:
    keys = sorted(element.attrib)
    if not keys:
        element.text = _other_value(draw, element.text or "")
        return
    key, other = draw(st.sampled_from(keys)), draw(st.sampled_from(keys))
    way = draw(st.sampled_from(["drop", "swap", *["change"] * 3]))
    if way == "drop":
        del element.attrib[key]
    elif way == "swap":
        element.attrib[key], element.attrib[other] = element.attrib[other], element.attrib[key]
    else:
        element.set(key, _other_value(draw, element.get(key, "")))


def _other_value(draw: Draw, value: str) -> str:
    """Draw a value with one word changed or dropped, or another one."""
    words = value.split()
    others = [*NUMBERS, "../../../../etc/passwd", "revolute", "floating", "0 0 0"]
    if not words or not draw(st.integers(0, 2)):
        return str(draw(st.sampled_from(others)))
    row = draw(st.integers(0, len(words) - 1))
    words[row : row + 1] = draw(st.lists(st.sampled_from(NUMBERS), max_size=1))
    return " ".join(words)


_TREES = {
    ".yaml": _yaml,
    ".json": _json,
    ".gltf": _json,
    ".jsonl": _json_lines,
    ".urdf": _xml,
    ".sdf": _xml,
    ".xml": _xml,
    ".dae": _xml,
}
