"""Refuse XML that is broken, or that does more than hold data."""

from __future__ import annotations

import xml.parsers.expat
from pathlib import Path

from lis_grasp.exceptions import InvalidFileError

# Elements within elements: a URDF has five, an SDF six.
_DEEPEST = 50


def require_plain_xml(path: Path) -> None:
    """Refuse a file that is no XML, or declares entities.

    Entities let a small file grow to gigabytes, or name files that are none of its business; no
    hand needs them.

    Raises
    ------
    InvalidFileError
        If it is so.
    """

    def refuse(*_: object) -> None:
        raise InvalidFileError(f"{path} must not declare XML entities: write their text out")

    def require_version(version: str, *_: object) -> None:
        if version not in ("1.0", "1.1"):  # expat reads on, other parsers guess
            raise InvalidFileError(f"{path} must be XML 1.0 or 1.1; it says '{version[:20]}'")

    parser = xml.parsers.expat.ParserCreate()
    parser.EntityDeclHandler, parser.XmlDeclHandler = refuse, require_version
    depth = 0

    def enter(*_: object) -> None:
        nonlocal depth
        depth += 1
        if depth > _DEEPEST:
            raise InvalidFileError(f"{path} must not nest elements deeper than {_DEEPEST}")

    def leave(_: str) -> None:
        nonlocal depth
        depth -= 1

    parser.StartElementHandler, parser.EndElementHandler = enter, leave
    try:
        parser.Parse(path.read_bytes(), True)
    except OSError as error:
        raise InvalidFileError(f"cannot read {path}: {error.strerror}") from None
    except (xml.parsers.expat.ExpatError, ValueError) as error:
        raise InvalidFileError(f"{path} is not valid XML: {error}") from None
