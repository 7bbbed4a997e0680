"""Checks of estimators: the package's own pass, and each deliberate fault fails its own check."""

from __future__ import annotations

import random
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from lis_grasp.contacts import Contacts
from lis_grasp.exceptions import FailedCheckError
from lis_grasp.surfaces import ESTIMATORS
from lis_grasp.testing import Check, _estimator_laws, check_estimator, estimator_checks

EXAMPLE = Path(__file__).parents[2] / "examples" / "own_package"
sys.path.insert(0, str(EXAMPLE))
from lis_grasp_example.nearest_plane import NearestPlane  # noqa: E402


class Sound(NearestPlane):
    """The estimator whose members the faults replace."""


class Queried:
    """A surface with some functions in place of its members."""

    def __init__(self, surface: Any, **members: Callable[..., Any]) -> None:
        self._surface, self._members = surface, members

    def __getattr__(self, name: str) -> Any:
        if name.startswith("_"):
            raise AttributeError(name)
        return self._members.get(name) or getattr(self._surface, name)


def fault(**members: Callable[..., Any]) -> Callable[..., Any]:
    """Return an estimator with functions (surface, points) in place of members."""

    def make(contacts: Contacts, *, position_noise: float = 0.0, normal_noise: float = 0.0) -> Any:
        surface = Sound(contacts, position_noise=position_noise, normal_noise=normal_noise)
        bound = {
            name: (lambda points, change=change: change(surface, points))
            for name, change in members.items()
        }
        return Queried(surface, **bound)

    return make


def bounded(bounds: Callable[[Contacts], Any]) -> Callable[..., Any]:
    """Return an estimator with other bounds."""

    def make(contacts: Contacts) -> Any:
        surface = Sound(contacts)
        surface.bounds = np.asarray(bounds(contacts))
        return surface

    return make


def changed(change: Callable[[Contacts], Contacts]) -> Callable[..., Any]:
    """Return an estimator of changed contacts."""
    return lambda contacts: Sound(change(contacts))


class Incomplete:
    """Has no uncertainty."""

    def __init__(self, contacts: Contacts) -> None:
        surface = Sound(contacts)
        self.bounds, self.evaluate, self.gradient = (
            surface.bounds,
            surface.evaluate,
            surface.gradient,
        )


class Remembering(Sound):
    """Adds the number of its queries to f."""

    count = 0

    def evaluate(self, points: Any) -> Any:
        self.count += 1
        return super().evaluate(points) + 1e-9 * self.count


class DrawingGlobally(Sound):
    """Draws from the global generator, without effect."""

    def __init__(self, contacts: Contacts) -> None:
        super().__init__(contacts)
        np.random.random()  # noqa: NPY002


class DrawingInPython(Sound):
    """Draws from Python's generator, without effect."""

    def evaluate(self, points: Any) -> Any:
        random.random()
        return super().evaluate(points)


class Unseeded(Sound):
    """Moves its surface a little, each time elsewhere."""

    def __init__(self, contacts: Contacts) -> None:
        super().__init__(contacts)
        self._shift = 1e-6 * np.random.default_rng().random()

    def evaluate(self, points: Any) -> Any:
        return super().evaluate(points) + self._shift


class Batched(Sound):
    """Subtracts the mean of a batch."""

    def evaluate(self, points: Any) -> Any:
        values = super().evaluate(points)
        return values - 1e-2 * np.mean(values)


class Writing(Sound):
    """Moves its contacts in place."""

    def __init__(self, contacts: Contacts) -> None:
        super().__init__(contacts)
        contacts.points.flags.writeable = True
        contacts.points[0] += 1e-6


class WritingQueries(Sound):
    """Subtracts a place from the points of a query in place."""

    def gradient(self, points: Any) -> Any:
        found = super().gradient(points)
        if isinstance(points, np.ndarray) and points.size:
            points -= 1e-9
        return found


class Closed(Sound):
    """Keeps a function, which cannot be pickled."""

    def __init__(self, contacts: Contacts) -> None:
        super().__init__(contacts)
        self.function = lambda: 0


class Slow(Sound):
    """Takes processor time that grows with contacts."""

    def __init__(self, contacts: Contacts) -> None:
        super().__init__(contacts)
        end = time.process_time() + (0.3 if len(contacts) >= 100 else 0.0)
        while time.process_time() < end:
            pass


class Needy(Sound):
    """Needs four contacts."""

    least = 4

    def __init__(self, contacts: Contacts) -> None:
        if 0 < len(contacts) < self.least:
            raise ValueError("too few")
        super().__init__(contacts)


class NeedsTwo(Needy):
    """Needs two contacts."""

    least = 2


class NeedsVolume(Sound):
    """Needs contacts that are in no plane."""

    def __init__(self, contacts: Contacts) -> None:
        if len(contacts) > 3 and np.linalg.matrix_rank(contacts.points - contacts.points[0]) < 3:
            raise ValueError("a plane")
        super().__init__(contacts)


class NeedsDistinct(Sound):
    """Needs contacts of which none is there twice."""

    def __init__(self, contacts: Contacts) -> None:
        if len(np.unique(contacts.points, axis=0)) < len(contacts):
            raise ValueError("twice")
        super().__init__(contacts)


class NeedsOnlyPoints(Sound):
    """Refuses contacts with more than points and normals."""

    def __init__(self, contacts: Contacts) -> None:
        if contacts.forces is not None:
            raise ValueError("forces")
        super().__init__(contacts)


def upward(contacts: Contacts) -> Contacts:
    """Return contacts stretched along z of their frame, about the origin."""
    stretch = np.array([1.0, 1.0, 1.4])
    normals = contacts.normals / stretch
    return Contacts(
        contacts.points * stretch, normals / np.linalg.norm(normals, axis=1, keepdims=True)
    )


def nearest_to_origin(contacts: Contacts) -> Contacts:
    """Return the contacts that are nearer than 0.3 m to the origin, or the first one."""
    near = np.linalg.norm(contacts.points, axis=1) < 0.3
    return contacts.subset(np.flatnonzero(near) if near.any() else np.array([0]))


def without_noise_of(contacts: Contacts, **noise: float) -> Any:
    """Return a surface that is far off if there is noise."""
    surface = Sound(contacts)
    off = 0.02 if noise.get("position_noise") else 0.0
    return Queried(surface, evaluate=lambda points: surface.evaluate(points) - off)


def thick(surface: Any, points: Any) -> Any:
    """Return f that is negative within 10 mm of a plate."""
    points = np.asarray(points)
    thin = np.ptp(surface._contacts.points[:, 2]) < 0.006
    return surface.evaluate(points) - (0.01 if thin else 0.0)


FAULTS: dict[str, Any] = {
    "members": Incomplete,
    "shape_of_values": fault(evaluate=lambda s, x: np.atleast_1d(s.evaluate(x))),
    "shape_of_gradients": fault(gradient=lambda s, x: np.reshape(s.gradient(x), (-1, 3))),
    "shape_of_uncertainties": fault(uncertainty=lambda s, x: np.ravel(s.uncertainty(x))),
    "type_of_numbers": fault(evaluate=lambda s, x: s.evaluate(x).astype(np.float32)),
    "lists_of_points": fault(gradient=lambda s, x: s.gradient(x[..., :])),
    "form_of_bounds": bounded(lambda c: c.bounds[::-1]),
    "bounds_hold_the_contacts": bounded(lambda c: 0.5 * c.bounds),
    "bounds_are_near": bounded(lambda c: 20.0 * c.bounds),
    "points_of_another_shape": fault(
        evaluate=lambda s, x: s.evaluate(np.reshape(np.resize(x, (np.size(x) // 3, 3)), (-1, 3)))
    ),
    "points_not_finite": fault(evaluate=lambda s, x: s.evaluate(np.nan_to_num(x))),
    "negative_inside": fault(evaluate=lambda s, x: np.abs(s.evaluate(x)) + 1e-9),
    "positive_outside": fault(evaluate=lambda s, x: -s.evaluate(x)),
    "sides_of_contacts": fault(evaluate=lambda s, x: s.evaluate(x) - 0.005),
    "zero_set_at_contacts": fault(evaluate=lambda s, x: s.evaluate(x) - 0.001),
    "gradient_is_the_slope": fault(gradient=lambda s, x: 2.0 * s.gradient(x)),
    "gradient_points_outward": fault(gradient=lambda s, x: -s.gradient(x)),
    "finite_everywhere": fault(
        evaluate=lambda s, x: np.where(
            np.linalg.norm(x, axis=-1) > 1.0, np.nan, s.evaluate(np.asarray(x))
        )
    ),
    "uncertainty_not_negative": fault(uncertainty=lambda s, x: -s.uncertainty(x) - 1e-9),
    "uncertainty_grows": fault(uncertainty=lambda s, x: 0.0 * s.uncertainty(x) + 0.001),
    "mesh_of_a_ball": fault(evaluate=lambda s, x: s.evaluate(x) + 0.004),
    "no_contacts": lambda contacts: Sound(
        contacts if len(contacts) else Contacts(np.zeros((1, 3)), np.eye(3)[:1])
    ),
    "turned": changed(upward),
    "moved": changed(nearest_to_origin),
    "scaled": fault(uncertainty=lambda s, x: 0.0 * s.uncertainty(x) + 0.001),
    "order_of_contacts": changed(lambda c: c.subset(np.arange((len(c) + 1) // 2))),
    "repeatable": Unseeded,
    "global_generator": DrawingGlobally,
    "global_generator of Python": DrawingInPython,
    "earlier_queries": Remembering,
    "batches": Batched,
    "contacts_unchanged": Writing,
    "queries_unchanged": WritingQueries,
    "pickles": Closed,
    "one_contact": NeedsTwo,
    "few_contacts": Needy,
    "one_plane": NeedsVolume,
    "repeated_contacts": NeedsDistinct,
    "noisy_contacts": without_noise_of,
    "contacts_with_all_fields": NeedsOnlyPoints,
    "thin_plate": fault(evaluate=thick),
    "many_contacts": Slow,
}
"""A fault for each check, named after it."""


def failed(checks: tuple[Check, ...]) -> dict[str, str]:
    failures: dict[str, str] = {}
    for check in checks:
        try:
            check()
        except FailedCheckError as error:
            failures |= error.failures
    return failures


def test_the_estimator_whose_members_are_replaced_passes() -> None:
    check_estimator(Sound)


@pytest.mark.parametrize("name", FAULTS)
def test_a_fault_fails_its_check(name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(_estimator_laws, "_SECONDS", 0.2)
    check = {str(c): c for c in estimator_checks(FAULTS[name])}[name.split()[0]]
    with pytest.raises(FailedCheckError) as caught:
        check()
    assert list(caught.value.failures) == [str(check)]


def test_every_check_has_a_fault() -> None:
    assert {str(check) for check in estimator_checks(Sound)} == {n.split()[0] for n in FAULTS}


@pytest.mark.slow
@pytest.mark.parametrize("name", ESTIMATORS)
def test_an_estimator_of_the_package_passes(name: str) -> None:
    check_estimator(name)


def test_all_failures_are_in_one_error() -> None:
    inside_out = fault(evaluate=lambda s, x: -s.evaluate(x))
    expected = failed(estimator_checks(inside_out))
    with pytest.raises(FailedCheckError) as caught:
        check_estimator(inside_out)
    assert caught.value.failures == expected
    first, second, *_ = expected
    assert f"{first}: {expected[first]}; {second}: {expected[second]}" in str(caught.value)
    assert all(name in str(caught.value) for name in expected)
    assert {"negative_inside", "positive_outside", "gradient_is_the_slope"} <= set(expected)


def test_an_error_of_the_estimator_is_a_failure_with_its_place() -> None:
    class Broken(Sound):
        def __init__(self, contacts: Contacts) -> None:
            raise IndexError("no such row")

    sentence = failed(estimator_checks(Broken))["negative_inside"]
    assert "IndexError" in sentence
    assert Path(__file__).name in sentence
