"""Definition of a study: objects, estimators, touches, noise, hands and seeds, fully crossed."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import fields
from pathlib import Path
from typing import Annotated, Any

import pydantic
from pydantic import BeforeValidator, ConfigDict, Field, StrictInt, StrictStr

from lis_grasp.exceptions import InvalidFileError, InvalidOptionError, shown
from lis_grasp.io.yaml_files import YAML_SUFFIXES, read_yaml
from lis_grasp.robots.hand import Hand
from lis_grasp.shapes import FORMATS
from lis_grasp.surfaces.estimators import ESTIMATOR_NAMES, find_estimator
from lis_grasp_studies.estimators import (
    COMPARED,
)
from lis_grasp_studies.study.trial import (
    OWN,
    SETTINGS,
    TRUTH,
    Setup,
    Trial,
    find_object,
    label,
    parse_noise,
    require_one_of,
    with_package_errors,
)
from lis_grasp_studies.test_objects.shape_sets import TEST_OBJECTS

_MOST_SEEDS = 100_000
# Whole numbers of a row's columns have 64 bits.
_INT64_END = 2**63
_LISTS = ("objects", "estimators", "touches", "noise", "hands", "seeds")


def _range_of(value: Any) -> Any:
    """Return seeds 0 to N - 1 for a number of seeds N."""
    if isinstance(value, bool) or not isinstance(value, int):
        return value
    if not 1 <= value <= _MOST_SEEDS:
        raise InvalidOptionError.out_of_range("seeds", value, f"1 to {_MOST_SEEDS}, or a list")
    return tuple(range(value))


_Names = Annotated[tuple[StrictStr, ...], Field(min_length=1)]
_Seeds = Annotated[
    tuple[Annotated[StrictInt, Field(ge=0, lt=_INT64_END)], ...],
    Field(min_length=1),
    BeforeValidator(_range_of, json_schema_input_type=int | list[int]),
]
_Touches = Annotated[
    tuple[Annotated[StrictInt, Field(ge=1, lt=_INT64_END)], ...], Field(min_length=1)
]


@with_package_errors
@pydantic.dataclasses.dataclass(frozen=True, config=ConfigDict(extra="forbid"))
class Study(Setup):
    """A full factorial study of objects, estimators, touches, noise levels, hands and seeds.

    Parameters
    ----------
    objects, touches, noise, hands, seeds
        See `Trial`; `seeds` may be a number of seeds.
    estimators
        Of `COMPARED`, a plug-in as ``my.module:Class``, or "truth": planning on the true mesh.
    reference
        The estimator that the others are compared with.

    Further parameters are those of `Setup`.

    Raises
    ------
    InvalidOptionError
        If a list is empty or repeats an entry, or a value is not permitted. Files are not opened
        before `require_files`.
    """

    objects: _Names = ("box", "cylinder", "pentagon", "mallet", "sphere", "torus")
    estimators: _Names = ("gpis", "lis", "blend")
    touches: _Touches = (10, 20, 40)
    noise: _Names = ("none", "1mm/3deg")
    hands: _Names = ("allegro",)
    seeds: _Seeds = tuple(range(10))
    reference: StrictStr = "gpis"

    def __post_init__(self) -> None:
        Setup.__post_init__(self)
        for name in _LISTS:
            _require_unique(name, getattr(self, name))
        for name in ("objects", "hands"):
            _require_unique(name, [label(path) for path in getattr(self, name)])
        permitted = ESTIMATOR_NAMES if self.explorer == OWN else COMPARED
        for estimator in self.estimators:
            if estimator != TRUTH:
                find_estimator(estimator, registry=permitted, option="estimators")
        require_one_of("reference", self.reference, self.estimators)
        for level in self.noise:
            parse_noise(level)
        for hand in self.hands:
            if Path(hand).suffix.lower() not in YAML_SUFFIXES:
                Hand.load(hand)
        for name in self.objects:
            # Test objects take seconds to build.
            if Path(name).suffix.lower() not in FORMATS and name not in TEST_OBJECTS:
                find_object(name, self)

    @property
    def setup(self) -> Setup:
        """The settings that all trials have in common."""
        return Setup(**{name: getattr(self, name) for name in SETTINGS})

    def require_files(self) -> None:
        """Read all files of objects and hands, before any work.

        Raises `InvalidFileError`, `InvalidMeshError` or `InvalidHandError` if one cannot be used.
        """
        for hand in self.hands:
            Hand.load(hand)
        for name in self.objects:
            find_object(name, self)

    def trials(self) -> list[Trial]:
        """Return every trial, seed by seed, so that a study stopped early is balanced."""
        setup = self.setup
        return [
            Trial(name, hand, touches, noise, seed, setup)
            for seed in self.seeds
            for name in self.objects
            for hand in self.hands
            for noise in self.noise
            for touches in sorted(self.touches)
        ]

    def facts(self) -> dict[str, Any]:
        """Return the study as plain values, as `from_facts` takes them."""
        values = {name: getattr(self, name) for name in (*_LISTS, "reference", *SETTINGS)}
        return {k: list(v) if isinstance(v, tuple) else v for k, v in values.items()}

    @classmethod
    def from_facts(cls, facts: Mapping[str, Any]) -> Study:
        """Return a study from plain values, such as those of a YAML file.

        Raises `InvalidOptionError` if a key is unknown or a value not permitted.
        """
        permitted = [item.name for item in fields(cls)]
        for name in facts:
            require_one_of("each key of a study", name, permitted)
        return cls(**facts)

    @classmethod
    def schema(cls) -> dict[str, Any]:
        """Return the JSON schema of a study file."""
        return pydantic.TypeAdapter(cls).json_schema()


def load_study(path: Path, meshes: Path | None = None) -> dict[str, Any]:
    """Read the facts of a study from a YAML file, for `Study.from_facts`.

    Relative paths in it start at its folder, those of mesh files at `meshes` if given.

    Raises `InvalidFileError` if it cannot be read, or is no mapping.
    """
    content = read_yaml(path)
    if not isinstance(content, dict):
        raise InvalidFileError(
            f"{path} must be a mapping, such as 'objects: [box, sphere]'; it is a"
            f" {type(content).__name__}",
            path=path,
        )
    return with_absolute_paths(content, path.parent, meshes)


def with_absolute_paths(
    facts: dict[str, Any], folder: Path, meshes: Path | None = None
) -> dict[str, Any]:
    """Return the facts of a study with absolute paths; values of wrong types stay as they are."""
    starts = {"objects": (meshes or folder, FORMATS), "hands": (folder, YAML_SUFFIXES)}

    def absolute(key: str, name: Any) -> Any:
        start, suffixes = starts[key]
        is_file = isinstance(name, str) and Path(name).suffix.lower() in suffixes
        return str((start / name).absolute()) if is_file else name

    lists = {key: facts[key] for key in starts if isinstance(facts.get(key), list)}
    return facts | {key: [absolute(key, name) for name in lists[key]] for key in lists}


def _require_unique(option: str, values: Sequence[Any]) -> None:
    value, count = Counter(values).most_common(1)[0]
    if count > 1:
        raise InvalidOptionError(
            f"{option} must differ, files by their names; {shown(value)} occurs {count} times",
            option=option,
            value=value,
        )
