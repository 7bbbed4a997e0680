"""Checks of a policy: its probes, its randomness, and what it makes of what it is told."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from lis_grasp.exploration.policy import POLICY_NAMES, Policy, PolicyKind
from lis_grasp.exploration.tactile_sensor import TactileSensor
from lis_grasp.exploration.workspace import Workspace
from lis_grasp.stages.touch import make_policy
from lis_grasp.testing._policy_claims import CLAIMS
from lis_grasp.testing._policy_subject import PolicySubject
from lis_grasp.testing.check import Check, HeldClaims, plugin_name, require_all


def policy_checks(policy: str | Callable[[Workspace], Policy]) -> tuple[Check, ...]:
    """Return the checks of a policy, to be carried out one by one, as by pytest.

    Parameters
    ----------
    policy
        A name, ``my.module:Class``, or what makes a policy of a `Workspace`.

    Raises
    ------
    InvalidOptionError
        If there is no such name.

    Examples
    --------
    >>> [str(check) for check in policy_checks("random")][:2]
    ['makes_a_policy', 'first_probe']
    """
    found: Any = POLICY_NAMES.find(policy) if isinstance(policy, str) else policy
    make = found
    if isinstance(found, PolicyKind):
        make = lambda space: make_policy(str(policy), space, TactileSensor())  # noqa: E731
    return CLAIMS.of(PolicySubject(make), plugin_name(policy))


def check_policy(policy: str | Callable[[Workspace], Policy]) -> HeldClaims:
    """Make and return all checks of a policy, which touches a block with a ball; a few seconds.

    Parameters
    ----------
    policy
        As in `policy_checks`.

    Raises
    ------
    FailedCheckError
        If it fails some, with a sentence on each in `failures`.

    Examples
    --------
    >>> check_policy("random")
    22 of 22 claims hold
    """
    return require_all(policy_checks(policy))
