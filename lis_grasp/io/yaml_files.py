"""YAML files: reading within limits, with one error for everything that is not YAML."""

from __future__ import annotations

import os
from collections import Counter
from collections.abc import Callable
from pathlib import Path
from typing import Any

import yaml

from lis_grasp.exceptions import InvalidFileError, shown
from lis_grasp.io.file_limits import MEBIBYTE, require_file_size

YAML_SUFFIXES = (".yaml", ".yml")
"""Endings of YAML files."""

_ROBOT_SUFFIXES = (".urdf", ".sdf", ".xml", ".xacro")

_MOST_BYTES = 2 * MEBIBYTE
MOST_NODES = 50_000
"""Values and keys of a YAML file, those of an alias counted wherever it is used."""
MOST_CHARACTERS = 10_000
"""Length of a value: PyYAML reads 1:59:59:... in the square of it."""


def find_yaml_file(
    name: str, what: str, *, example: str, advice: str, error: Callable[..., Exception]
) -> Path | None:
    """Return the path of a file that is there; None for what may be a name.

    Parameters
    ----------
    name
        A path or a name, as a user gave it.
    what
        ``hand`` or ``arm``, which the file describes.
    example, advice
        For messages: a name that exists, and how to write the YAML file of a URDF or SDF.
    error
        Class of the error, which has the file's name.

    Raises
    ------
    error
        For a URDF or SDF, or a YAML file that is not there.
    """
    path = Path(name)
    ending = path.suffix.lower()
    if ending in _ROBOT_SUFFIXES:
        message = f"the {what} file must be YAML; {path} is {ending[1:].upper()}: {advice}"
        raise error(message, file=path.name)
    if os.path.isfile(path):
        return path
    if ending in YAML_SUFFIXES:
        message = (
            f"the {what} file {path} does not exist: check its path, or name {example} instead"
        )
        raise error(message, file=path.name)
    return None


def read_yaml(path: Path) -> Any:
    """Return the content of a YAML file of plain values.

    Raises
    ------
    InvalidFileError
        If the file cannot be read, is not YAML, repeats a key, has an alias inside of itself, or
        is larger than 2 MiB, `MOST_NODES` or, in one value, `MOST_CHARACTERS`.
    """
    try:
        require_file_size(path, _MOST_BYTES)
        text = path.read_text(encoding="utf-8")
    except OSError as error:
        raise InvalidFileError(f"cannot read {path}: {error.strerror}", path=path) from None
    except UnicodeDecodeError:
        raise InvalidFileError(f"{path} is not UTF-8 text: save it as YAML", path=path) from None
    try:
        return _content(text)
    # Scalars that do not fit their tags raise errors of half a dozen built-in types.
    except Exception as error:  # noqa: BLE001
        reason = " ".join(str(error).split()) or type(error).__name__
        if not isinstance(error, yaml.YAMLError | ValueError | RecursionError):
            reason = f"a value does not fit its tag ({reason})"
        raise InvalidFileError(f"{path} is not valid YAML: {reason}", path=path) from None


def is_plain_text(text: str) -> bool:
    """Return whether YAML reads `text`, written without quotes, as this text."""
    try:
        return bool(text) and yaml.safe_load(f"[{text}]") == [text]
    # Not an error of the caller: text that YAML cannot read, for whatever reason, needs quotes.
    except Exception:  # noqa: BLE001 - of half a dozen types, as in read_yaml
        return False


class _LimitedLoader(yaml.SafeLoader):
    """Loader of plain values that ends early in a file of too many or too long ones."""

    composed = 0

    def compose_node(self, parent: yaml.Node | None, index: Any) -> yaml.Node | None:
        """Return the next node; see `yaml.composer.Composer`."""
        self.composed += 1
        _require_few(self.composed)
        return super().compose_node(parent, index)

    def compose_scalar_node(self, anchor: Any) -> yaml.ScalarNode:
        """Return the next scalar; see `yaml.composer.Composer`."""
        node: yaml.ScalarNode = super().compose_scalar_node(anchor)
        if len(node.value) > MOST_CHARACTERS:
            raise ValueError(f"a value has more than {MOST_CHARACTERS} characters")
        return node


def _content(text: str) -> Any:
    loader = _LimitedLoader(text)
    try:
        node = loader.get_single_node()
        if node is None:
            return None
        _count(node, {}, set())
        # Only now: merged mappings are copied, wherever they are used.
        return loader.construct_document(node)
    finally:
        loader.dispose()


def _count(node: yaml.Node, known: dict[yaml.Node, int], around: set[yaml.Node]) -> int:
    """Return the number of nodes in a node, aliases expanded; ValueError beyond the limit."""
    if node in around:
        raise ValueError("an alias is inside of its own anchor")
    if node not in known:
        around.add(node)
        parts = node.value if isinstance(node, yaml.CollectionNode) else []
        if isinstance(node, yaml.MappingNode):
            _require_unique_keys(node)
            parts = [part for pair in parts for part in pair]
        known[node] = 1 + sum(_count(part, known, around) for part in parts)
        around.remove(node)
        _require_few(known[node])
    return known[node]


def _require_few(count: int) -> None:
    if count > MOST_NODES:
        raise ValueError(f"it has more than {MOST_NODES} values, those of aliases included")


def _require_unique_keys(node: yaml.MappingNode) -> None:
    keys = Counter((key.tag, key.value) for key, _ in node.value if key.tag.endswith(":str"))
    for (_, key), count in keys.items():
        if count > 1:
            raise ValueError(f"the key {shown(key)} occurs {count} times in one mapping")
