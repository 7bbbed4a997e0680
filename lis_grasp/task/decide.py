"""How the robot decides: its estimator, its policy, when it stops, and what it attempts."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from types import MappingProxyType
from typing import Any

from lis_grasp.exploration.policy import POLICY_NAMES, PolicyKind, require_policy_maker
from lis_grasp.io.option import (
    FRACTION,
    NOT_LARGE,
    POSITIVE,
    PROBABILITY,
    at_least,
    option,
    record_of_options,
)
from lis_grasp.plugins import qualified_name
from lis_grasp.surfaces.estimators import (
    ESTIMATOR_MEANINGS,
    ESTIMATOR_NAMES,
    find_estimator,
    maker_of,
)
from lis_grasp.task.option_groups import GRASPING, SURFACE, TOUCHING

POLICY_MEANINGS: Mapping[str, str] = MappingProxyType(
    {
        "spread": "farthest from all contacts",
        "frontier": "next to the contacts, as in the paper",
        "uncertainty": "where the estimate is most uncertain",
        "random": "anywhere on the estimate",
    }
)
"""The package's policies in words."""


PLACES = ("table", "corner")
"""Kinds of places for an object that is held."""


TOUCHES_AFTER_A_VIEW = 5
"""Touches that are made by default of an object that a camera saw before."""


def _estimator(name: str, value: Any) -> Any:
    find_estimator(value) if isinstance(value, str) else maker_of(value, qualified_name(value))
    return value


def _policy(name: str, value: Any) -> Any:
    make = POLICY_NAMES.find(value) if isinstance(value, str) else value
    if not isinstance(make, PolicyKind):
        require_policy_maker(make, value if isinstance(value, str) else qualified_name(value))
    return value


@record_of_options
class Decide:
    """The estimator, the policy, the stop rules, the plan and the attempts.

    Examples
    --------
    >>> Decide(estimator="gpis", touches=20).attempts
    3
    """

    estimator: str | Callable[..., Any] = option(
        "blend",
        "surface estimator",
        SURFACE,
        metavar="NAME",
        check=_estimator,
        registry=ESTIMATOR_NAMES,
        meanings=ESTIMATOR_MEANINGS,
    )
    free_space: bool = option(
        True,
        "remove the space that the hand passed through from the estimate",
        SURFACE,
        words="yes",
    )
    keep_all: bool = option(
        False,
        "believe every contact: do not turn or leave out those that the others contradict",
        SURFACE,
    )
    policy: str | Callable[..., Any] = option(
        "spread",
        "choice of the next touch",
        TOUCHING,
        metavar="NAME",
        check=_policy,
        registry=POLICY_NAMES,
        meanings=POLICY_MEANINGS,
    )
    fingers: str = option(
        "one",
        "fingers that touch in one approach; all needs `prober` kinematic",
        TOUCHING,
        choices=("one", "all"),
    )
    touches: int = option(
        40,
        "touches to make",
        TOUCHING,
        metavar="N",
        words=f"40; {TOUCHES_AFTER_A_VIEW} after a view",
        check=at_least(1),
    )
    slide: float = option(
        0.0,
        "slide so far along a fixed object after a touch, for a second contact",
        TOUCHING,
        metavar="METRES",
        check=NOT_LARGE,
    )
    until_success: float | None = option(
        None,
        "stop when the surface allows a grasp that holds with this probability, such as 0.95",
        TOUCHING,
        metavar="PROBABILITY",
        check=PROBABILITY,
    )
    until_coverage: float | None = option(
        None,
        "stop when this fraction of the estimate is within a step of a contact",
        TOUCHING,
        metavar="FRACTION",
        check=FRACTION,
    )
    until_uncertainty: float | None = option(
        None,
        "stop when nearly all of the estimate has at most this standard deviation",
        TOUCHING,
        metavar="METRES",
        check=POSITIVE,
    )
    max_seconds: float | None = option(
        None,
        "stop after this time of the robot, in a region only when its object's ends are found",
        TOUCHING,
        metavar="S",
        check=POSITIVE,
    )
    grasps: int = option(
        10, "ranked grasps to plan, 20 after one failed", GRASPING, metavar="N", check=at_least(1)
    )
    attempts: int = option(
        3,
        "grasps to lift at most; another is planned after each that fails",
        GRASPING,
        metavar="N",
        check=at_least(1),
    )
    closings: int = option(
        5,
        "grasps to test at most before each lift: the hand closes gently, and lifts if the measured"
        " contacts are in firm force closure; 0 lifts the first",
        GRASPING,
        metavar="N",
        check=at_least(0),
    )
    place: str | None = option(
        None,
        "where a held object is put down and let go: at a new place on the table, or in a corner of"
        " two walls, which the task adds",
        GRASPING,
        choices=PLACES,
    )
