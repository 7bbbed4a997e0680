"""What a study compares: objects, estimators, touches, noise, hands and seeds, all with all."""

from __future__ import annotations

import contextlib
import difflib
import re
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, field, fields
from pathlib import Path
from typing import Any

import numpy as np

from lis_grasp.contacts import Contacts
from lis_grasp.exceptions import (
    EstimationError,
    InvalidContactsError,
    InvalidOptionError,
    shown,
)
from lis_grasp.experiments.compared_estimators import CONTENDERS, Noise, contender
from lis_grasp.experiments.study.keys import HAND_SUFFIXES, label
from lis_grasp.exploration import POLICIES
from lis_grasp.hands.hand import Hand
from lis_grasp.pipeline.run_config import RunConfig
from lis_grasp.shapes import FORMATS, NAMES, UNITS, Shape, find
from lis_grasp.surfaces import ESTIMATORS

TRUTH = "truth"
"""In place of an estimator: plan on the true mesh. No upper bound: a planner errs there, too."""

OWN = "own"
"""As the explorer: each estimator drives an exploration of its own."""

_NOISE = re.compile(r"(\d+(?:\.\d+)?)mm/(\d+(?:\.\d+)?)deg")
# A study of more seeds ends in nobody's lifetime.
_MOST_SEEDS = 100_000
# Whole numbers of a row's columns have 64 bits.
_ENDLESS = 2**63
_LISTS = ("objects", "estimators", "touches", "noise", "hands", "seeds")


@dataclass(frozen=True, slots=True)
class Setup:
    """What all trials of a study have in common.

    Parameters
    ----------
    prober
        "kinematic" or "dynamic", see `RunConfig`.
    explorer
        Estimator that drives the exploration, whose contacts all estimators get; "own": each
        estimator drives its own, and contacts differ.
    policy
        What chooses the next touch, see `RunConfig`; "spread" asks no explorer.
    size
        Largest extent of built-in shapes [m]; None for one that a hand can grasp.
    units
        Length unit of mesh files.
    mass, friction
        Of the true object in the lift [kg], and of hand on object.
    grasps
        Ranked grasps to plan; the first is executed.
    """

    prober: str = "kinematic"
    explorer: str = "blend"
    policy: str = "spread"
    size: float | None = None
    units: str = "m"
    mass: float = 0.2
    friction: float = 0.8
    grasps: int = 5

    def __post_init__(self) -> None:
        _require("explorer", self.explorer, (*ESTIMATORS, OWN))
        for name in ("mass", "friction", "size"):
            value = getattr(self, name)
            if name == "size" and value is None:
                continue
            if isinstance(value, bool) or not isinstance(value, (int, float)):
                raise InvalidOptionError(f"{name} must be a number; it is {shown(value)}")
            # 1 and 1.0 are one setup, and rows of it have one key.
            object.__setattr__(self, name, float(min(value, 1e300)))
        _require("units", self.units, tuple(UNITS))
        if isinstance(self.grasps, bool) or not isinstance(self.grasps, int):
            raise InvalidOptionError(f"grasps must be a whole number; it is {shown(self.grasps)}")
        # The border of a run is the border of a trial.
        RunConfig(
            prober=self.prober,
            policy=self.policy,
            mass=self.mass,
            friction=self.friction,
            grasps=self.grasps,
        )
        if self.explorer == OWN and POLICIES[self.policy].uses_gaussian_process:
            raise InvalidOptionError(
                "estimators drive explorations of their own by a policy that follows them, as"
                f" frontier or uncertainty does; the policy is '{self.policy}'"
            )


@dataclass(frozen=True, slots=True, order=True)
class Trial:
    """One object, touched by one hand, under one noise, from one seed.

    Its contacts are made once; then every estimator has its try at them.

    Parameters
    ----------
    object
        Name of a built-in shape, or path of a mesh file.
    hand
        Name of a shipped hand, or path of a hand's YAML file.
    touches
        Contacts to make: those of a larger budget begin with those of a smaller one.
    noise
        Of the tactile sensor: "none", or one standard deviation as "1mm/3deg".
    seed
        Of exploration, sensor and planning.
    """

    object: str
    hand: str
    touches: int
    noise: str
    seed: int


TRIAL_COLUMNS = tuple(field.name for field in fields(Trial))
"""Columns of a row that say which trial it is of."""


@dataclass(frozen=True, slots=True)
class Study:
    """Objects x estimators x touch budgets x noise levels x hands x seeds.

    Parameters
    ----------
    objects, touches, noise, hands, seeds
        What trials are made of, see `Trial`.
    estimators
        Of `CONTENDERS`, or "truth": planning on the true mesh.
    reference
        The estimator that the others are compared with.
    setup
        What all trials have in common.

    Raises
    ------
    InvalidOptionError
        If a list is empty, names something twice, or names something that there is not; files are
        not looked for before `require_files`.
    """

    objects: tuple[str, ...] = ("box", "cylinder", "pentagon", "mallet", "sphere", "torus")
    estimators: tuple[str, ...] = ("gpis", "lis", "blend")
    touches: tuple[int, ...] = (10, 20, 40)
    noise: tuple[str, ...] = ("none", "1mm/3deg")
    hands: tuple[str, ...] = ("allegro",)
    seeds: tuple[int, ...] = tuple(range(10))
    reference: str = "gpis"
    setup: Setup = field(default_factory=Setup)

    def __post_init__(self) -> None:
        for name in _LISTS:
            values = getattr(self, name)
            if not values:
                raise InvalidOptionError(f"{name} must name at least one; none came")
            if len(set(values)) < len(values):
                twice = next(v for v in values if values.count(v) > 1)
                raise InvalidOptionError(f"{name} must not repeat; {shown(twice)} came twice")
        driving = self.setup.explorer == OWN
        for name in self.estimators:
            _require("estimators", name, (*(ESTIMATORS if driving else CONTENDERS), TRUTH))
            if name not in (*ESTIMATORS, TRUTH):
                _require_installed(name)
        if self.reference not in self.estimators:
            raise InvalidOptionError(
                f"the study compares with '{self.reference}': add it to estimators"
                f" ({', '.join(self.estimators)}), or choose another reference"
            )
        for name, least in (("touches", 1), ("seeds", 0)):
            for value in getattr(self, name):
                if isinstance(value, bool) or not isinstance(value, int) or value < least:
                    raise InvalidOptionError(
                        f"{name} must be whole numbers from {least} on; {shown(value)} came"
                    )
                if value >= _ENDLESS:
                    raise InvalidOptionError(f"{name} must be less than 2^63; {shown(value)} came")
        for level in self.noise:
            parse_noise(level)
        for hand in self.hands:
            if Path(hand).suffix.lower() not in HAND_SUFFIXES:
                Hand.load(hand)  # which says what the names are
        for name in self.objects:
            if Path(name).suffix.lower() not in FORMATS:
                find_object(name, self.setup)
        for what in (self.objects, self.hands):
            names = [label(name) for name in what]
            if len(set(names)) < len(names):
                twice = next(n for n in names if names.count(n) > 1)
                raise InvalidOptionError(
                    f"files of a study must differ by name, as rows are named after them;"
                    f" {twice} came from two folders: rename one"
                )

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
            find_object(name, self.setup)

    def trials(self) -> list[Trial]:
        """Return every trial, seed by seed, so that a study stopped early is balanced."""
        return [
            Trial(name, hand, touches, noise, seed)
            for seed in self.seeds
            for name in self.objects
            for hand in self.hands
            for noise in self.noise
            for touches in sorted(self.touches)
        ]

    def facts(self) -> dict[str, Any]:
        """Return the study as plain values, as `from_facts` takes them."""
        lists = {name: list(getattr(self, name)) for name in _LISTS}
        return {**lists, "reference": self.reference, **asdict(self.setup)}

    @classmethod
    def from_facts(cls, facts: Mapping[str, Any]) -> Study:
        """Return a study from plain values; `seeds` may be a number of seeds.

        Raises
        ------
        InvalidOptionError
            If a name is unknown or a value not permitted.
        """
        common = [item.name for item in fields(Setup)]
        permitted = (*_LISTS, "reference", *common)
        for name in facts:
            _require("a study's keys", str(name), permitted)
        chosen: dict[str, Any] = {
            name: _listed(name, facts[name]) for name in _LISTS if name in facts
        }
        if "reference" in facts:
            chosen["reference"] = facts["reference"]
        setup = Setup(**{name: facts[name] for name in common if name in facts})
        return cls(**chosen, setup=setup)


def parse_noise(level: str) -> Noise:
    """Return a level of noise from its name: "none", or "1mm/3deg"."""
    if level == "none":
        return Noise()
    match = _NOISE.fullmatch(level) if isinstance(level, str) else None
    if match is None:
        raise InvalidOptionError(f"noise must be 'none' or like '1mm/3deg'; {shown(level)} came")
    return Noise(1e-3 * float(match[1]), float(np.deg2rad(float(match[2]))))


def find_object(name: str, setup: Setup) -> Shape:
    """Return the true object of a name; the size is for built-in shapes, the units for files."""
    return find(name, size=setup.size if name in NAMES else None, units=setup.units)


def _require_installed(name: str) -> None:
    """Refuse an estimator whose packages are missing: each of its rows would be a failure."""
    axes = np.vstack([np.eye(3), -np.eye(3)])
    with contextlib.suppress(EstimationError, InvalidContactsError):
        contender(name)(Contacts(0.03 * axes, axes), Noise())


def _listed(name: str, value: Any) -> tuple[Any, ...]:
    if name == "seeds" and isinstance(value, int) and not isinstance(value, bool):
        if value < 1:
            raise InvalidOptionError(f"seeds must be at least 1; {shown(value)} came")
        if value > _MOST_SEEDS:
            raise InvalidOptionError(
                f"seeds must be at most {_MOST_SEEDS}; {shown(value)} came:"
                " list those that you want"
            )
        return tuple(range(value))
    if isinstance(value, str) or not isinstance(value, Sequence):
        raise InvalidOptionError(f"{name} must be a list; {shown(value)} came")
    kind = int if name in ("touches", "seeds") else str
    for item in value:
        if not isinstance(item, kind):
            wanted = "whole numbers" if kind is int else "names"
            raise InvalidOptionError(f"{name} must be {wanted}; {shown(item)} came")
    return tuple(value)


def _require(what: str, value: Any, choices: Sequence[str]) -> None:
    if isinstance(value, str) and value in choices:
        return
    close = difflib.get_close_matches(str(value), choices, n=1)
    hint = f"; did you mean '{close[0]}'?" if close else ""
    raise InvalidOptionError(
        f"{what} must be among {', '.join(choices)}; {shown(value)} came{hint}"
    )
