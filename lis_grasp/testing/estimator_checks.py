"""Checks of an estimator: its form, its values, and its laws."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from lis_grasp.surfaces.estimators import ESTIMATOR_NAMES
from lis_grasp.testing._estimator_laws import LAWS
from lis_grasp.testing._estimator_subject import EstimatorSubject
from lis_grasp.testing._estimator_values import CLAIMS
from lis_grasp.testing.check import Check, HeldClaims, plugin_name, require_all


def estimator_checks(estimator: str | Callable[..., Any]) -> tuple[Check, ...]:
    """Return the checks of an estimator, to be carried out one by one, as by pytest.

    Parameters
    ----------
    estimator
        A name, ``my.module:Class``, a class with `from_contacts`, or a function of contacts.

    Raises
    ------
    InvalidOptionError
        If there is no such name.

    Examples
    --------
    >>> checks = estimator_checks("lis")
    >>> len({str(check) for check in checks}) == len(checks) > 30
    True
    """
    found = ESTIMATOR_NAMES.find(estimator) if isinstance(estimator, str) else estimator
    subject = EstimatorSubject(getattr(found, "from_contacts", found))
    name = plugin_name(estimator)
    return (*CLAIMS.of(subject, name), *LAWS.of(subject, name))


def check_estimator(estimator: str | Callable[..., Any]) -> HeldClaims:
    """Make and return all checks of an estimator on a ball, a block and a plate; ten seconds.

    Parameters
    ----------
    estimator
        As in `estimator_checks`.

    Raises
    ------
    FailedCheckError
        If it fails some, with a sentence on each in `failures`.

    Examples
    --------
    >>> check_estimator("lis")
    41 of 41 claims hold
    """
    return require_all(estimator_checks(estimator))
