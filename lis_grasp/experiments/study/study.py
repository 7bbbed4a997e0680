"""Definition of a study: objects, estimators, touches, noise, hands and seeds, fully crossed."""

from __future__ import annotations

import contextlib
import functools
import re
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, fields
from pathlib import Path
from typing import Annotated, Any, TypeVar

import numpy as np
import pydantic
from pydantic import BeforeValidator, ConfigDict, Field, StrictFloat, StrictInt, StrictStr

from lis_grasp.contacts import Contacts
from lis_grasp.exceptions import (
    EstimationError,
    InvalidContactsError,
    InvalidFileError,
    InvalidOptionError,
    shown,
)
from lis_grasp.experiments.compared_estimators import COMPARED, Noise, compared_estimator
from lis_grasp.experiments.test_objects.shape_sets import TEST_OBJECTS, graspable_shape
from lis_grasp.exploration import POLICIES
from lis_grasp.hands.hand import Hand
from lis_grasp.io.yaml_files import read_yaml
from lis_grasp.pipeline.conditions import CONDITIONS
from lis_grasp.pipeline.object_setup import pose_of
from lis_grasp.pipeline.plugged_in import ESTIMATOR_NAMES, POLICY_NAMES, find_estimator
from lis_grasp.pipeline.run_config import PROBERS, RunConfig
from lis_grasp.shapes import FORMATS, NAMES, UNITS, Shape, find, placed
from lis_grasp.surfaces import ESTIMATORS

TRUTH = "truth"
"""In place of an estimator: plan on the true mesh. No upper bound, because a planner errs too."""

OBJECT_NAMES = (*NAMES, *TEST_OBJECTS)
"""Objects that a study knows by name: built-in shapes and test objects; others are mesh files."""

DEFAULT_CONDITIONS = "known"
"""The conditions of all studies before version 0.11."""

OWN = "own"
"""In place of an explorer: each estimator drives an exploration of its own."""

_HAND_SUFFIXES = (".yaml", ".yml")
_NOISE = re.compile(r"(\d+(?:\.\d+)?)mm/(\d+(?:\.\d+)?)deg")
_MOST_SEEDS = 100_000
# Whole numbers of a row's columns have 64 bits.
_INT64_END = 2**63
_LISTS = ("objects", "estimators", "touches", "noise", "hands", "seeds")

Record = TypeVar("Record", bound=type)


def _with_package_errors(record: Record) -> Record:
    """Make a pydantic dataclass raise InvalidOptionError for its first error."""
    initialise = record.__init__  # type: ignore[misc]

    @functools.wraps(initialise)
    def __init__(self: Any, *arguments: Any, **values: Any) -> None:  # noqa: N807
        try:
            initialise(self, *arguments, **values)
        except pydantic.ValidationError as error:
            first = error.errors()[0]
            option, *place = (str(part) for part in first["loc"])
            where = f"{option}, entry {place[0]}," if place and place[0].isdigit() else option
            reason = first["msg"].lower().replace("tuple", "list")
            raise InvalidOptionError(
                f"{where} is not permitted: {reason}; it is {shown(first['input'])}",
                option=option,
                value=first["input"],
            ) from None

    record.__init__ = __init__  # type: ignore[misc]
    return record


def _one_of(choices: Sequence[str], default: str) -> Any:
    return Field(default=default, json_schema_extra={"enum": list(choices)})


def _known(names: Sequence[str], default: str) -> Any:
    """Return a field of a name that may also be a plug-in's."""
    return Field(default=default, json_schema_extra={"examples": list(names)})


@_with_package_errors
@pydantic.dataclasses.dataclass(frozen=True, config=ConfigDict(extra="forbid"))
class Setup:
    """Settings that all trials of a study have in common.

    Raises
    ------
    InvalidOptionError
        If a value is not permitted.
    """

    prober: StrictStr = _one_of(PROBERS, "kinematic")
    """Prober, "kinematic" or "dynamic", see `RunConfig`."""
    explorer: StrictStr = _known([*ESTIMATORS, OWN], "blend")
    """Estimator that drives the exploration, whose contacts all estimators get; "own": each
    estimator drives its own, and contacts differ."""
    policy: StrictStr = _known(list(POLICIES), "spread")
    """Chooses the next touch, see `RunConfig`; "spread" uses no explorer."""
    size: StrictFloat | None = None
    """Largest extent of objects known by name [m]; None for one that a hand can grasp."""
    units: StrictStr = _one_of(list(UNITS), "m")
    """Length unit of mesh files."""
    mass: StrictFloat = 0.2
    """Mass of the true object in the lift [kg]."""
    friction: StrictFloat = 0.8
    """Coefficient between hand and object."""
    grasps: StrictInt = 5
    """Ranked grasps to plan; the first is executed."""
    conditions: StrictStr = _one_of(tuple(CONDITIONS), DEFAULT_CONDITIONS)
    """"known": place, size, mass and friction are known, and the object is fixed while it is
    touched. "unknown": it stands free in a region of a table, in a stable pose; the sensor has a
    threshold and taxels; this needs the dynamic prober."""

    def __post_init__(self) -> None:
        if self.explorer != OWN:
            find_estimator(self.explorer, option="explorer")
        _require("units", self.units, tuple(UNITS))
        _require("conditions", self.conditions, tuple(CONDITIONS))
        self.run_config()
        kind = POLICY_NAMES.find(self.policy)
        if self.explorer == OWN and getattr(kind, "uses_gaussian_process", False):
            raise InvalidOptionError(
                "explorer 'own' needs a policy that uses the estimate, such as frontier or"
                f" uncertainty; the policy is '{self.policy}'",
                option="policy",
                value=self.policy,
            )

    def run_config(self, **more: Any) -> RunConfig:
        """Return the configuration of a run with these settings and `more` of `RunConfig`."""
        names = ("prober", "policy", "mass", "friction", "grasps")
        facts = {name: getattr(self, name) for name in names}
        return RunConfig(**{**CONDITIONS[self.conditions], **facts, **more})


@dataclass(frozen=True, slots=True)
class Trial:
    """One object, touched by one hand, with one level of noise and one seed, for all estimators."""

    object: str
    """One of `OBJECT_NAMES`, or path of a mesh file."""
    hand: str
    """Name of a shipped hand, or path of a hand's YAML file."""
    touches: int
    """Contacts to make: those of a larger budget begin with those of a smaller one."""
    noise: str
    """Noise of the tactile sensor: "none", or standard deviations as "1mm/3deg"."""
    seed: int
    """Seed of exploration, sensor and planning, together with the object's name."""
    setup: Setup = field(default_factory=Setup)
    """Settings that all trials of a study have in common."""

    @property
    def random_seed(self) -> int:
        """Seed of the generators of this object's trials: objects draw independent numbers."""
        entropy = [self.seed, *label(self.object).encode()]
        return int(np.random.SeedSequence(entropy).generate_state(1)[0])

    def find_object(self) -> Shape:
        """Return the true object, at its pose at the start."""
        shape = _find(self.object, self.setup)
        X_WO = pose_of(shape, self.run_config())
        return shape if X_WO is None else placed(shape, X_WO)

    def run_config(self, **more: Any) -> RunConfig:
        """Return the configuration of a run of this trial, with `more` of `RunConfig`.

        The trial's noise is not part of it, nor are the touches.
        """
        return self.setup.run_config(object=self.object, seed=self.random_seed, **more)

    def explorer(self, estimator: str) -> str:
        """Return the estimator that drives the exploration for an estimator."""
        if self.setup.explorer != OWN:
            return self.setup.explorer
        # Planning on the truth needs no contacts; they measure what was explored.
        return Setup().explorer if estimator == TRUTH else estimator


SETTINGS = tuple(item.name for item in fields(Setup))
"""Columns of a row with the settings of its study."""

TRIAL_COLUMNS = tuple(item.name for item in fields(Trial) if item.name != "setup")
"""Columns of a row that identify its trial within a study."""


def label(name: str) -> str:
    """Return the name of an object or a hand in rows: a built-in name, or its file's name."""
    return Path(name).name


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


@_with_package_errors
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
            if estimator not in (*ESTIMATORS, TRUTH):
                _require_installed(estimator)
        _require("reference", self.reference, self.estimators)
        for level in self.noise:
            parse_noise(level)
        for hand in self.hands:
            if Path(hand).suffix.lower() not in _HAND_SUFFIXES:
                Hand.load(hand)
        for name in self.objects:
            # Test objects take seconds to build.
            if Path(name).suffix.lower() not in FORMATS and name not in TEST_OBJECTS:
                _find(name, self)

    @property
    def setup(self) -> Setup:
        """The settings that all trials have in common."""
        return Setup(**{name: getattr(self, name) for name in SETTINGS})

    def require_files(self) -> None:
        """Read all files of objects and hands, before any work.

        Raises
        ------
        InvalidFileError, InvalidMeshError, InvalidHandError
            If one cannot be used.
        """
        for hand in self.hands:
            Hand.load(hand)
        for name in self.objects:
            _find(name, self)

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

        Raises
        ------
        InvalidOptionError
            If a key is unknown or a value not permitted.
        """
        permitted = [item.name for item in fields(cls)]
        for name in facts:
            _require("each key of a study", name, permitted)
        return cls(**facts)

    @classmethod
    def schema(cls) -> dict[str, Any]:
        """Return the JSON schema of a study file."""
        return pydantic.TypeAdapter(cls).json_schema()


def load_study(path: Path, meshes: Path | None = None) -> dict[str, Any]:
    """Read the facts of a study from a YAML file, for `Study.from_facts`.

    Relative paths in it start at its folder, those of mesh files at `meshes` if given.

    Raises
    ------
    InvalidFileError
        If it cannot be read, or is no mapping.
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
    starts = {"objects": (meshes or folder, FORMATS), "hands": (folder, _HAND_SUFFIXES)}

    def absolute(key: str, name: Any) -> Any:
        start, suffixes = starts[key]
        is_file = isinstance(name, str) and Path(name).suffix.lower() in suffixes
        return str((start / name).absolute()) if is_file else name

    lists = {key: facts[key] for key in starts if isinstance(facts.get(key), list)}
    return facts | {key: [absolute(key, name) for name in lists[key]] for key in lists}


def parse_noise(level: str) -> Noise:
    """Return a level of noise from its name: "none", or "1mm/3deg"."""
    if level == "none":
        return Noise()
    match = _NOISE.fullmatch(level)
    if match is None:
        raise InvalidOptionError.out_of_range("noise", level, "'none' or like '1mm/3deg'")
    return Noise(1e-3 * float(match[1]), float(np.deg2rad(float(match[2]))))


def _find(name: str, setup: Setup) -> Shape:
    if name in TEST_OBJECTS:
        return graspable_shape(name, setup.size)
    return find(name, size=setup.size if name in NAMES else None, units=setup.units)


def _require(option: str, value: Any, choices: Sequence[str]) -> None:
    if value not in choices:
        raise InvalidOptionError.not_one_of(option, value, choices)


def _require_unique(option: str, values: Sequence[Any]) -> None:
    value, count = Counter(values).most_common(1)[0]
    if count > 1:
        raise InvalidOptionError(
            f"{option} must differ, files by their names; {shown(value)} occurs {count} times",
            option=option,
            value=value,
        )


def _require_installed(estimator: str) -> None:
    """Reject an estimator whose packages are missing: each of its rows would be a failure."""
    axes = np.vstack([np.eye(3), -np.eye(3)])
    with contextlib.suppress(EstimationError, InvalidContactsError):
        compared_estimator(estimator)(Contacts(0.03 * axes, axes), Noise())
