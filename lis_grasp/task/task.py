"""The task of a run: a world, a robot, prior knowledge, and how the robot decides."""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterable, Iterator, Mapping
from dataclasses import dataclass, field, replace
from functools import cache
from operator import attrgetter
from types import MappingProxyType
from typing import Any, TypeVar

from lis_grasp.contacts import FARTHEST
from lis_grasp.exceptions import InvalidOptionError, listed
from lis_grasp.guesses import Answering, advice_on_keyword
from lis_grasp.io.option import (
    Option,
    at_least,
    checked_value,
    items_of,
    kind_of,
    option,
    options_of,
    within,
)
from lis_grasp.plugins import qualified_name
from lis_grasp.shapes import STABLE
from lis_grasp.task.decide import TOUCHES_AFTER_A_VIEW, Decide
from lis_grasp.task.known import Known
from lis_grasp.task.robot import REAL_SENSOR, Robot
from lis_grasp.task.world import World
from lis_grasp.world import Surroundings

IDEAL_SENSOR: Mapping[str, Any] = MappingProxyType(dict.fromkeys(REAL_SENSOR, 0.0))
"""A tactile sensor without noise."""

IDEAL_CAMERA: Mapping[str, Any] = MappingProxyType({"hand_eye": (0.0, 0.0), "depth_noise": "none"})
"""A camera without noise, at exactly the known pose."""

KNOWN: Mapping[str, Any] = MappingProxyType(
    {"pose": None, "region": None, "free": False, "load": "known", **IDEAL_SENSOR, **IDEAL_CAMERA}
)
"""Place, size, mass and friction are known, the object is fixed at its mesh's pose, and the
sensor is ideal. Without these, only a region is known, the object is free in a stable pose, and the
sensor is realistic."""

OLD_NAMES: Mapping[str, str] = MappingProxyType({"obstacles": "world"})
"""Options by their names in 2.0, with those of today; both are read until 4.0."""

LIFTING = ("grasps", "attempts", "closings", "simulator", "place")
"""Options that the exploration of a run does not depend on."""

HEIGHT = within(f"at most {FARTHEST:g} m from 0", lambda value: abs(value) <= FARTHEST)
"""Check of the height of a table [m]."""

_Task = TypeVar("_Task", bound="Task")


@dataclass(frozen=True, slots=True)
class Task(Answering):
    """A world, a robot, what it knows beforehand, how it decides, and the seed of random draws.

    `Task.of` takes all by name, as ``lis-grasp run`` does.

    Raises
    ------
    InvalidOptionError
        If options contradict each other.

    Examples
    --------
    >>> task = Task.of("mallet", hand="wsg50", touches=20)
    >>> task.robot.hand, task.decide.touches, task.world.is_free
    ('wsg50', 20, True)
    """

    world: World = field(default_factory=lambda: World())
    robot: Robot = field(default_factory=lambda: Robot())
    known: Known = field(default_factory=lambda: Known())
    decide: Decide = field(default_factory=lambda: Decide())
    seed: int = option(0, "random seed", metavar="N", check=at_least(0))

    def __post_init__(self) -> None:
        declared = options_of(Task)["seed"]
        object.__setattr__(self, "seed", checked_value("seed", self.seed, int, declared.check))
        for name, message in self._contradictions():
            raise InvalidOptionError(message, option=name)

    def _contradictions(self) -> Iterator[tuple[str, str]]:
        world, arm, fingers = self.world, self.robot.arm, self.decide.fingers
        if fingers != "one" and world.prober != "kinematic":
            yield "fingers", f"fingers '{fingers}' need the kinematic prober; it is {world.prober}"
        if self.known.region is not None and world.pose is None:
            required = "a pose there, such as 'stable'; there is none"
            yield "pose", f"an object in a region needs {required}"
        at, bodies = self.known.at, self.known.world
        if at is not None and not isinstance(bodies, str):
            yield "at", f"`at` is a place in a file of bodies, `world`; it is {at} without a file"
        if arm is not None and world.simulator != "drake":
            yield (
                "arm",
                (
                    "an arm is simulated in drake alone: leave out `arm`, or give `simulator`"
                    f" drake; it is {world.simulator}"
                ),
            )

    @classmethod
    def of(
        cls: type[_Task], object: Any = None, *, known: bool | None = None, **options: Any
    ) -> _Task:
        """Return the task of options by their names, as in ``lis-grasp run``.

        `known` is ``--known``: place, size, mass and friction of the object are known, it is fixed,
        and the sensor is ideal. None means True with a cloud, which shows the place. After a view
        fewer touches are made by default. Given options replace these and the defaults.

        Raises `InvalidOptionError` if a value is not permitted, `TypeError` for another name.
        """
        given = options if object is None else {"object": object, **options}
        if given.get("camera") or given.get("views"):
            given = {"touches": TOUCHES_AFTER_A_VIEW} | given
        is_known = given.get("cloud") is not None if known is None else known
        return _made(cls, (_known_with(given) if is_known else {}) | given)

    @classmethod
    def from_facts(
        cls: type[_Task],
        given: Mapping[str, Any],
        recorded: Mapping[str, Any] = MappingProxyType({}),
    ) -> _Task:
        """Return the task of values by name: given, else recorded, else from `KNOWN`.

        None and other names count as absent. A recorded estimator, policy or hand that is not among
        the given names is left out, as it is not used and perhaps not installed. An object other
        than the recorded one has another size and units.
        """
        left_out = {name for name in ("estimator", "policy", "hand") if name not in given}
        if given.get("object") not in (None, recorded.get("object")):
            left_out |= {"size", "units", "up"}
        facts = dict(KNOWN)
        for values in ({k: v for k, v in recorded.items() if k not in left_out}, given):
            values = {OLD_NAMES.get(name, name): value for name, value in values.items()}
            facts |= {n: values[n] for n in task_options() if values.get(n) is not None}
        return _made(cls, facts)

    def having(self: _Task, *, known: bool | None = None, **options: Any) -> _Task:
        """Return the task with other values of some options, by their names.

        `known` True also sets the values of `KNOWN`, False the defaults of these options.

        Examples
        --------
        >>> Task().having(touches=3, hand="wsg50").decide.touches
        3
        """
        if known is not None:
            usual = Task().facts() | {"free": None}
            start = _known_with(options) if known else {name: usual[name] for name in KNOWN}
            options = start | options
        return _made(type(self), options, self)

    def facts(self) -> dict[str, Any]:
        """Return every option by its name as a plain value, for headers of files and reports."""
        return {name: plain_value(read(self)) for name, read in _readers().items()}

    @property
    def on_table(self) -> bool:
        """Whether the object is on a table: placed on one, free, or near an arm."""
        return self.world.pose is not None or self.world.is_free or self.robot.arm is not None

    @property
    def sees(self) -> bool:
        """Whether cameras see the object before the first touch."""
        return self.robot.camera or bool(self.known.views)

    @property
    def may_slide(self) -> bool:
        """Whether a fingertip may slide: on a fixed object, alone, and without an arm."""
        return not self.world.is_free and self.robot.arm is None and self.decide.fingers == "one"

    def require_slides(self) -> None:
        """Raise `InvalidOptionError` if touches are to slide and may not."""
        slide = self.decide.slide
        if slide and not self.may_slide:
            needed = "a fixed object (not `free`: --clamped or --known), one finger and no arm"
            raise InvalidOptionError(f"slide needs {needed}", option="slide", value=slide)


PARTS: Mapping[str, Any] = MappingProxyType(
    {"world": World, "robot": Robot, "known": Known, "decide": Decide}
)
"""The records of a task by the names of its fields."""


def require_options(given: Iterable[str], accepted: Collection[str]) -> None:
    """Raise `TypeError` for the first given option that is not accepted."""
    for name in sorted({*given} - {*accepted}):
        raise TypeError(f"there is no option '{name}'{advice_on_keyword(name, accepted)}")


def task_options() -> dict[str, Option]:
    """Return the declaration of every option of a task by its name."""
    declared = {name: o for part in PARTS.values() for name, o in options_of(part).items()}
    return declared | options_of(Task)


def option_kind(name: str) -> type:
    """Return the type of an option's values beside None; see `kind_of`."""
    return kind_of(next((p for p in PARTS.values() if name in options_of(p)), Task), name)


def option_items(name: str) -> type:
    """Return the type of the items of an option that is a tuple; see `items_of`."""
    return items_of(next(p for p in PARTS.values() if name in options_of(p)), name)


def option_default(name: str) -> Any:
    """Return the default of an option."""
    return _readers()[name](_usual_task())


@cache
def _usual_task() -> Task:
    return Task()


def plain_value(value: Any) -> Any:
    """Return the value of an option for a file: a tuple as a list, an object by its names."""
    if isinstance(value, tuple):
        return list(value)
    if isinstance(value, Surroundings):
        return listed([body.name for body in value])
    return qualified_name(value) if callable(value) else value


def _known_with(given: Mapping[str, Any]) -> dict[str, Any]:
    """Return the options of `KNOWN`, with a pose if a region is given."""
    return {**KNOWN, "pose": STABLE} if given.get("region") is not None else dict(KNOWN)


@cache
def _readers() -> dict[str, Callable[[Task], Any]]:
    """Return a function for each option that reads its value from a task."""
    readers: dict[str, Callable[[Task], Any]] = {}
    for part, record in PARTS.items():
        for name in options_of(record):
            readers[name] = attrgetter(f"{part}.{name}")
    return readers | {"free": attrgetter("world.is_free"), "seed": attrgetter("seed")}


def _made(cls: type[_Task], options: Mapping[str, Any], start: Task | None = None) -> _Task:
    """Return a task of options by name, the others from `start` or else the defaults."""
    options = {OLD_NAMES.get(name, name): value for name, value in options.items()}
    require_options(options, task_options())
    parts: dict[str, Any] = {}
    for part, record in PARTS.items():
        own = {name: options[name] for name in options_of(record) if name in options}
        parts[part] = record(**own) if start is None else replace(getattr(start, part), **own)
    seed = options.get("seed", 0 if start is None else start.seed)
    return cls(**parts, seed=seed)
