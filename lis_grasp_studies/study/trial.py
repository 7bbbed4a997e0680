"""Trials of a study: one object, hand, number of touches, noise level and seed; keys of rows."""

from __future__ import annotations

import functools
import hashlib
import json
import re
from collections.abc import Sequence
from dataclasses import asdict, dataclass, field, fields
from pathlib import Path
from typing import Any, TypeVar

import numpy as np
import pydantic
from pydantic import ConfigDict, Field, StrictFloat, StrictInt, StrictStr

from lis_grasp.exceptions import InvalidFileError, InvalidOptionError, shown
from lis_grasp.exploration import POLICIES
from lis_grasp.exploration.policy import POLICY_NAMES
from lis_grasp.robots.shipped_models import HAND_NAMES, VENDOR_HANDS, hand_path
from lis_grasp.robots.yaml_files import description_of
from lis_grasp.shapes import NAMES, UNITS, Shape, find
from lis_grasp.stages.scenario import place_object
from lis_grasp.surfaces import ESTIMATORS
from lis_grasp.surfaces.estimators import find_estimator
from lis_grasp.task.task import Task
from lis_grasp.task.world import PROBERS
from lis_grasp_studies.estimators import COMPARED, Noise
from lis_grasp_studies.test_objects.shape_sets import TEST_OBJECTS, graspable_shape

TRUTH = "truth"
"""In place of an estimator: plan on the true mesh. No upper bound, because a planner errs too."""

OBJECT_NAMES = (*NAMES, *TEST_OBJECTS)
"""Objects that a study knows by name: built-in shapes and test objects; others are mesh files."""

_CONDITIONS = ("known", "unknown")
DEFAULT_CONDITIONS = "known"
"""The conditions of all studies before version 0.11."""

OWN = "own"
"""In place of an explorer: each estimator drives an exploration of its own."""

KEY_LENGTH = 16
"""Digits of keys and digests in rows."""

_NOISE = re.compile(r"(\d+(?:\.\d+)?)mm/(\d+(?:\.\d+)?)deg")

Record = TypeVar("Record", bound=type)


def with_package_errors(record: Record) -> Record:
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


@with_package_errors
@pydantic.dataclasses.dataclass(frozen=True, config=ConfigDict(extra="forbid"))
class Setup:
    """Settings that all trials of a study have in common.

    Raises `InvalidOptionError` if a value is not permitted.
    """

    prober: StrictStr = _one_of(PROBERS, "kinematic")
    """Prober, "kinematic" or "dynamic", see `World`."""
    explorer: StrictStr = _known([*ESTIMATORS, OWN], "blend")
    """Estimator that drives the exploration, whose contacts all estimators get; "own": each
    estimator drives its own, and contacts differ."""
    policy: StrictStr = _known(list(POLICIES), "spread")
    """Chooses the next touch, see `Decide`; "spread" uses no explorer."""
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
    attempts: StrictInt = 1
    """Grasps to lift at most: after each that fails, another is planned on all contacts
    (`grasp_with_tactile_check`)."""
    closings: StrictInt = 0
    """Grasps to test at most before each lift, by closing gently; 0: the first is lifted."""
    conditions: StrictStr = _one_of(_CONDITIONS, DEFAULT_CONDITIONS)
    """"known": place, size, mass and friction are known, and the object is fixed while it is
    touched. "unknown": it is free in a region of a table, in a stable pose; the sensor has a
    threshold and taxels; this needs the dynamic prober."""

    def __post_init__(self) -> None:
        if self.explorer != OWN:
            find_estimator(self.explorer, option="explorer")
        require_one_of("units", self.units, tuple(UNITS))
        require_one_of("conditions", self.conditions, _CONDITIONS)
        self.run_config()
        kind = POLICY_NAMES.find(self.policy)
        if self.explorer == OWN and getattr(kind, "uses_gaussian_process", False):
            raise InvalidOptionError(
                "explorer 'own' needs a policy that uses the estimate, such as frontier or"
                f" uncertainty; the policy is '{self.policy}'",
                option="policy",
                value=self.policy,
            )

    def run_config(self, **more: Any) -> Task:
        """Return the task of a run with these settings and `more` options of `Task.of`."""
        is_known = self.conditions == "known"
        names = ("prober", "policy", "mass", "friction", "grasps", "attempts", "closings")
        facts = {name: getattr(self, name) for name in names}
        return Task.of(**{"known": is_known, "free": not is_known, **facts, **more})


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
        shape, _ = place_object(find_object(self.object, self.setup), self.run_config())
        return shape

    def run_config(self, **more: Any) -> Task:
        """Return the task of a run of this trial, with `more` options of `Task.of`.

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


def parse_noise(level: str) -> Noise:
    """Return a level of noise from its name: "none", or "1mm/3deg"."""
    if level == "none":
        return Noise()
    match = _NOISE.fullmatch(level)
    if match is None:
        raise InvalidOptionError.out_of_range("noise", level, "'none' or like '1mm/3deg'")
    return Noise(1e-3 * float(match[1]), float(np.deg2rad(float(match[2]))))


def find_object(name: str, setup: Setup) -> Shape:
    """Return an object by its name or mesh file, with the size and units of a setup."""
    if name in TEST_OBJECTS:
        return graspable_shape(name, setup.size)
    return find(name, size=setup.size if name in NAMES else None, units=setup.units)


def require_one_of(option: str, value: Any, choices: Sequence[str]) -> None:
    """Raise InvalidOptionError unless a value is one of the choices."""
    if value not in choices:
        raise InvalidOptionError.not_one_of(option, value, choices)


def row_key(trial: Trial, estimator: str) -> str:
    """Return the key of a row: a hash of everything that decides its content.

    An object's mesh file and a hand's YAML, URDF and SDF count by name and content, not by folder;
    plug-ins by name and source file.
    """
    digests = [*file_digests(trial.object, trial.hand), *_plugin_digests(trial, estimator)]
    setup = asdict(trial.setup)
    for name, usual in (("conditions", DEFAULT_CONDITIONS), ("attempts", 1), ("closings", 0)):
        if setup[name] == usual:  # keys of before there were others stay
            del setup[name]
    text = json.dumps([columns_of(trial), setup, estimator, *digests], sort_keys=True)
    return hashlib.sha256(text.encode()).hexdigest()[:KEY_LENGTH]


def columns_of(trial: Trial) -> dict[str, Any]:
    """Return the columns of a row that identify its trial within a study."""
    values = {name: getattr(trial, name) for name in TRIAL_COLUMNS}
    return values | {"object": label(trial.object), "hand": label(trial.hand)}


def file_digests(object_name: str, hand_name: str) -> tuple[str, ...]:
    """Return hashes of the files of an object and a hand; none of built-in ones."""
    files = [] if object_name in OBJECT_NAMES else [Path(object_name)]
    if hand_name in VENDOR_HANDS:
        files += [hand_path(hand_name), description_of(hand_name)[0]]
    elif hand_name not in HAND_NAMES:
        hand = Path(hand_name)
        hand = hand if hand.suffix else hand_path(hand_name)  # of an installed package
        files += [hand, *sorted(hand.parent.glob("*.urdf")), *sorted(hand.parent.glob("*.sdf"))]
    return tuple(map(_file_digest, files))


def _plugin_digests(trial: Trial, estimator: str) -> list[str]:
    """Return hashes of the sources of plugged-in estimators and policies."""
    estimators = {estimator, trial.setup.explorer} - {TRUTH, OWN}
    digests = [COMPARED.digest(name) for name in sorted(estimators)]
    return [digest for digest in (*digests, POLICY_NAMES.digest(trial.setup.policy)) if digest]


def object_digest(name: str) -> str | None:
    """Return a hash of an object's mesh file; None for one known by name."""
    return None if name in OBJECT_NAMES else _file_digest(Path(name))


def _file_digest(path: Path) -> str:
    try:
        facts = path.stat()
        return _digest(path, facts.st_mtime_ns, facts.st_size)
    except OSError as error:
        raise InvalidFileError(f"cannot read {path}: {error.strerror}", path=path) from None


@functools.cache
def _digest(path: Path, _changed: int, _size: int) -> str:
    return hashlib.sha256(path.read_bytes()).hexdigest()
