"""Types of the values in files, and one sentence for the first value that is not of its type."""

from __future__ import annotations

import json
import re
from collections import defaultdict
from collections.abc import Callable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Annotated, Any, TypeVar

from pydantic import BaseModel, ConfigDict, Field, ValidationError
from pydantic_core import ErrorDetails

from lis_grasp.exceptions import InvalidFileError, nearest_of, shown
from lis_grasp.io.limits import reading

# A larger number in a file is damage, whatever its unit.
_LARGEST = 1e12
# The key of a message names this many nested places at most.
_DEEPEST = 6

Number = Annotated[float, Field(ge=-_LARGEST, le=_LARGEST)]
Count = Annotated[int, Field(ge=0)]
Vector = Annotated[list[Number], Field(min_length=3, max_length=3)]
Pose = Annotated[
    list[Annotated[list[Number], Field(min_length=4, max_length=4)]],
    Field(min_length=4, max_length=4),
]
"""A rigid transform, row by row."""

_Schema = TypeVar("_Schema", bound=BaseModel)


class FileRecord(BaseModel):
    """Base of the records of a file: no value is converted, and further keys are kept."""

    model_config = ConfigDict(extra="allow", strict=True, frozen=True, defer_build=True)


def first_mistake(
    invalid: ValidationError, known: Mapping[str, Sequence[str]] | None = None
) -> tuple[str, str]:
    """Return the dotted key of the first wrong value, and what is wrong, to follow the key.

    An unknown key is compared with the `known` ones, which have their dotted places, outer first.
    """
    errors = invalid.errors(include_url=False)
    first = errors[0]
    place = first["loc"][:_DEEPEST]
    key = "".join(f"[{k}]" if isinstance(k, int) else f".{k}" for k in place).lstrip(".")
    if first["type"] == "missing":
        return key, f"is missing{_misspelt(errors, first['loc'][:-1])}"
    if first["type"].startswith("union_tag"):  # the key that selects the record
        tag, choices = (first["ctx"].get(n, "") for n in ("tag", "expected_tags"))
        key += f".{first['ctx']['discriminator']}".replace("'", "")
        return key, f"must be one of {choices}; it is {shown(tag)}" if choices else "is missing"
    if first["type"] == "extra_forbidden":
        return key, f"is an unknown key{_place_of(str(place[-1]), known or {})}"
    reason = re.sub(r"^\w+ should", "must", first["msg"].removeprefix("Value error, "))
    reason = re.sub(r"valid dictionary( or instance of \w+)?", "mapping", reason)
    reason = reason.replace(" after validation", "")
    return key, f"{reason}; it is {shown(first['input'])}"


def _place_of(key: str, known: Mapping[str, Sequence[str]]) -> str:
    """Return the clause about the place of a key that is known, or about a similar one."""
    if key in known:
        return f" there: write {known[key][-1]}"
    near = nearest_of(key, known)
    return re.sub(r"'(.*)'", lambda match: f"'{known[match[1]][0]}'", near)


def _places(schema: Mapping[str, Any], records: Mapping[str, Any], at: str) -> Iterator[str]:
    """Yield the dotted places of the keys of a JSON schema and of the records in it."""
    for key, value in schema.get("properties", {}).items():
        yield at + key
        for kind in (value, *value.get("anyOf", ())):
            name, inner = f"{at}{key}.", kind.get("additionalProperties")
            if isinstance(inner, Mapping):  # a mapping whose own keys are free
                name, kind = f"{name}NAME.", inner
            record = kind.get("$ref", "").rpartition("/")[2]
            yield from _places(records.get(record, {}), records, name)


def _misspelt(errors: Sequence[ErrorDetails], mapping: tuple[int | str, ...]) -> str:
    """Return the clause about the first unknown key of a mapping that lacks keys, or nothing."""
    inside = [error for error in errors if error["loc"][:-1] == mapping]
    unknown, missing = (
        [str(error["loc"][-1]) for error in inside if error["type"] == kind]
        for kind in ("extra_forbidden", "missing")
    )
    if not unknown:
        return ""
    return f", and {shown(unknown[0])} is an unknown key{nearest_of(unknown[0], missing)}"


def parse_entry(
    schema: type[_Schema], document: Any, file: str, error: Callable[..., Exception]
) -> _Schema:
    """Return the checked content of a YAML file of that name.

    Raises `error` if a value is not permitted; it has the file and the first wrong key.
    """
    try:
        return schema.model_validate(document)
    except ValidationError as invalid:
        described = schema.model_json_schema()
        records = described.get("$defs", {})
        known = defaultdict(list)
        for place in sorted(_places(described, records, ""), key=lambda place: place.count(".")):
            known[place.rpartition(".")[2]].append(place)
        key, reason = first_mistake(invalid, known)
    raise error(f"{file}: {key or 'the file'} {reason}", file=file, key=key)


def write_json_schema(schema: type[BaseModel], path: Path) -> None:
    """Write the JSON schema, by which editors complete and check a YAML file."""
    path.write_text(json.dumps(schema.model_json_schema(), indent=1) + "\n", encoding="utf-8")


def read_json(schema: type[_Schema], path: Path, what: str, cure: str = "repair it") -> _Schema:
    """Return the content of a JSON file as a record; for errors see `reading` and `checked`."""
    with reading(path, "JSON", advice=cure):
        content = json.loads(path.read_text(encoding="utf-8"))
    return checked(schema, content, path, what, f": {cure}")


def checked(schema: type[_Schema], content: Any, path: Path, what: str, cure: str = "") -> _Schema:
    """Return the content of a file as a record; `what` names it in the message, `cure` ends it.

    Raises `InvalidFileError` if a value is not of its type; the message names the first.
    """
    try:
        return schema.model_validate(content)
    except ValidationError as invalid:
        key, reason = first_mistake(invalid)
        raise InvalidFileError(
            f"{path} has no valid {what}: {key or 'it'} {reason}{cure}", path=path, field=key
        ) from None
