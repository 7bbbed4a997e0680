"""Scene files: a whole task as YAML, nested as its records are, with a schema for editors."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Annotated, Any, get_args, get_type_hints

import yaml
from pydantic import BaseModel, ConfigDict, Field, create_model

from lis_grasp.exceptions import InvalidInputError
from lis_grasp.io.atomic_writing import write_text
from lis_grasp.io.option import Option, options_of
from lis_grasp.io.schemas import parse_entry
from lis_grasp.io.yaml_files import YAML_SUFFIXES, read_yaml
from lis_grasp.task.task import (
    PARTS,
    Task,
    option_default,
    option_items,
    option_kind,
    plain_value,
)
from lis_grasp.world.files import file_of

_PATHS = ("object", "pose", "hand", "arm", "cloud", "world")


class InvalidSceneError(InvalidInputError):
    """A scene file with an unknown key, or a value of a wrong type.

    Attributes
    ----------
    file
        Name of the file.
    key
        Dotted key in it, for example ``world.mass``.
    """

    def __init__(self, message: str, *, file: str = "", key: str = "") -> None:
        super().__init__(message)
        self.file, self.key = file, key


def is_scene_file(name: object) -> bool:
    """Return whether a name or path has the ending of a scene file."""
    return isinstance(name, (str, Path)) and Path(name).suffix.lower() in YAML_SUFFIXES


def load_scene(path: Path | str) -> Task:
    """Return the task of a scene file.

    Raises `InvalidFileError` if the file cannot be read, `InvalidSceneError` if a key is unknown or
    a value of a wrong type, and the errors of `Task`.

    Examples
    --------
    >>> write_scene(Task.of("mallet", hand="wsg50"), "mallet.yaml")
    >>> load_scene("mallet.yaml").robot.hand
    'wsg50'
    """
    path = Path(path)
    document = read_yaml(path)
    scene = parse_entry(SceneFile, document or {}, path.name, InvalidSceneError)
    options = {"seed": scene.seed} if "seed" in scene.model_fields_set else {}
    for part in PARTS:
        options |= getattr(scene, part).model_dump(exclude_unset=True)
    for name in _PATHS:
        if options.get(name):
            options[name] = _located(options[name], path.parent)
    if options.get("views"):
        options["views"] = [_located(name, path.parent) for name in options["views"]]
    return Task.of(**options)


def _located(name: str, folder: Path) -> str:
    """Return the path of a file of that name in a folder, if there is one, else the name."""
    beside = folder / name
    return str(beside) if file_of(beside).is_file() else name


def write_scene(task: Task, path: Path | str) -> None:
    """Write a task as a scene file, every option with its value, and the schema beside it.

    Examples
    --------
    >>> write_scene(Task.of("box", touches=20), "box.yaml")
    >>> load_scene("box.yaml") == Task.of("box", touches=20)
    True
    """
    path = Path(path)
    content = {part: _plain(getattr(task, part)) for part in PARTS} | {"seed": task.seed}
    text = yaml.safe_dump(content, sort_keys=False, allow_unicode=True)
    write_text(path, f"# yaml-language-server: $schema={SCHEMA_NAME}\n{text}")
    write_text(path.with_name(SCHEMA_NAME), schema_text())


SCHEMA_NAME = "scene.schema.json"
"""File name of the schema of scene files."""


def schema_text() -> str:
    """Return the JSON schema of scene files, with the meaning of every option."""
    return json.dumps(SceneFile.model_json_schema(), indent=1) + "\n"


class _Part(BaseModel):
    model_config = ConfigDict(extra="forbid", strict=True, frozen=True)


def _field(name: str, option: Option, *, optional: bool) -> tuple[Any, Any]:
    """Return type and declaration of an option in a file; a tuple becomes a list."""
    kind, choices = option_kind(name), [*option.choices, *([None] if optional else [])]
    in_file: Any = list[option_items(name)] if kind is tuple else kind  # type: ignore[misc]
    extra: Any = {"enum": choices} if option.choices else None
    declared = Field(description=option.help, json_schema_extra=extra)
    return Annotated[in_file | None if optional else in_file, declared], option_default(name)


def _part(record: Any) -> type[_Part]:
    hints = get_type_hints(record)
    fields: dict[str, Any] = {
        name: _field(name, option, optional=type(None) in get_args(hints[name]))
        for name, option in options_of(record).items()
    }
    return create_model(record.__name__, __base__=_Part, **fields)


_SECTIONS: dict[str, Any] = {
    part: (_part(record), Field(default_factory=_part(record))) for part, record in PARTS.items()
}
_SECTIONS["seed"] = _field("seed", options_of(Task)["seed"], optional=False)
SceneFile: Any = create_model("SceneFile", __base__=_Part, **_SECTIONS)
"""The content of a scene file."""


def _plain(record: Any) -> dict[str, Any]:
    """Return the options of a record as plain values."""
    return {name: plain_value(getattr(record, name)) for name in options_of(record)}
