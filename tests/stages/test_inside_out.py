"""An estimator that is inside out is refused, whatever the contacts; a sound one is not."""

from collections.abc import Callable

import numpy as np
import pytest

import lis_grasp as lg
from lis_grasp import Contacts, ImplicitSurface
from lis_grasp.exceptions import InvalidOptionError
from lis_grasp.stages.estimate import Perception, SurfaceEstimate
from lis_grasp.typing import FloatArray


class Signed:
    """A GPIS with signs of its value and of its gradient."""

    signs = (1.0, 1.0)

    def __init__(self, contacts: Contacts) -> None:
        self._surface = lg.GaussianProcessImplicitSurface.from_contacts(contacts)
        self.bounds, self.uncertainty = self._surface.bounds, self._surface.uncertainty

    def evaluate(self, points: FloatArray) -> FloatArray:
        return self.signs[0] * self._surface.evaluate(points)

    def gradient(self, points: FloatArray) -> FloatArray:
        return self.signs[1] * self._surface.gradient(points)


class Inside(Signed):
    signs = (-1.0, -1.0)


class NegativeValue(Signed):
    signs = (-1.0, 1.0)


class NegativeGradient(Signed):
    signs = (1.0, -1.0)


@pytest.fixture(scope="module")
def touched() -> Contacts:
    """Contacts on a table, with free space around them, as of a run."""
    options = {"known": True, "pose": "stable", "prober": "kinematic", "touches": 8}
    return lg.explore("box", "wsg50", estimator="gpis", **options).contacts


@pytest.mark.parametrize(
    ("kind", "member"),
    [(Inside, "evaluate"), (NegativeValue, "evaluate"), (NegativeGradient, "gradient")],
)
@pytest.mark.parametrize("table", [None, 0.0])
def test_a_wrong_sign_is_refused(
    touched: Contacts, kind: Callable[[Contacts], ImplicitSurface], member: str, table: float | None
) -> None:
    assert len(touched.free_points)
    for estimator in (kind, f"{__name__}:{kind.__name__}"):
        known = Perception(estimator=estimator, support_height=table, normals="outward")
        for part in ("surface", "guide"):
            with pytest.raises(InvalidOptionError, match=f"{member} must .*: change its sign"):
                getattr(SurfaceEstimate(touched, known), part)
        with pytest.raises(InvalidOptionError, match=f"{member} must .*: change its sign"):
            lg.estimate(touched, estimator, support_height=table)


def test_right_signs_give_the_same_surface_as_the_class_inside(touched: Contacts) -> None:
    points = touched.points + 0.01 * touched.normals
    known = SurfaceEstimate(touched, Perception(estimator=Signed)).surface.evaluate(points)
    expected = SurfaceEstimate(touched, Perception(estimator="gpis")).surface.evaluate(points)
    np.testing.assert_allclose(known, expected, rtol=1e-6, atol=1e-9)
