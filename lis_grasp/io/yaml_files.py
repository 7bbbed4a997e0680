"""YAML files: reading within limits, with one error for everything that is not YAML."""

from __future__ import annotations

import json
import os
from collections.abc import Callable
from pathlib import Path
from typing import Any

import yaml

from lis_grasp.io.limits import MEBIBYTE, ReadError, parse_yaml, reading

YAML_SUFFIXES = (".yaml", ".yml")
"""Endings of YAML files."""

_ROBOT_SUFFIXES = (".urdf", ".sdf", ".xml", ".xacro")

_MOST_BYTES = 2 * MEBIBYTE


def find_yaml_file(
    name: str, what: str, *, example: str, advice: str, error: Callable[..., Exception]
) -> Path | None:
    """Return the path of an existing file; None for what may be a name.

    Parameters
    ----------
    name
        A path or a name, as a user gave it.
    what
        ``hand`` or ``arm``: what the file describes.
    example, advice
        For messages: a name that exists, and how to write the YAML file of a URDF or SDF.
    error
        Class of the error, which gets the file's name.

    Raises
    ------
    error
        For a URDF or SDF, or a missing YAML file.
    """
    path = Path(name)
    ending = path.suffix.lower()
    if ending in _ROBOT_SUFFIXES:
        raise error(
            f"the {what} file must be YAML; {path} is {ending[1:].upper()}: {advice}",
            file=path.name,
        )
    if os.path.isfile(path):
        return path
    if ending in YAML_SUFFIXES:
        raise error(
            f"the {what} file {path} does not exist: check its path, or name a ready"
            f" {what}, such as {example}",
            file=path.name,
        )
    return None


# PyYAML's errors for scalars that do not fit their tags.
_MISFITS = (AttributeError, LookupError, OverflowError, TypeError)


def read_yaml(path: Path) -> Any:
    """Return the content of a YAML file of plain values.

    Raises `InvalidFileError` if the file cannot be read, is not YAML, repeats a key, has an alias
    inside of itself, or is larger than 2 MiB or the limits of `parse_yaml`.
    """
    with reading(path, "YAML", most=_MOST_BYTES):
        text = path.read_text(encoding="utf-8")
        try:
            return parse_yaml(text)
        except _MISFITS:
            raise ReadError("a value does not fit its tag") from None


def word(text: str) -> str:
    """Return a YAML scalar: as it is if YAML reads a plain word as text, else quoted."""
    return text if is_plain_text(text) else json.dumps(text, ensure_ascii=False)


def is_plain_text(text: str) -> bool:
    """Return whether YAML reads `text`, without quotes, as this text in a list of either style."""
    try:
        return bool(text) and all(
            yaml.safe_load(form) == [text] for form in (f"[{text}]", f"- {text}")
        )
    # This is no error of the caller: text that YAML cannot read, for any reason, needs quotes.
    except (*_MISFITS, RecursionError, ValueError, yaml.YAMLError):
        return False
