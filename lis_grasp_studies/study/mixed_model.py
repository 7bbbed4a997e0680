"""A mixed-effects logistic model of success, with objects and seeds as crossed random effects."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.stats import t as student

from lis_grasp.exceptions import InvalidOptionError
from lis_grasp.io.json_lines import Row
from lis_grasp.io.optional_packages import needed_package
from lis_grasp.typing import BoolArray, FloatArray, IntArray
from lis_grasp_studies.statistics import numbered

_INTERCEPT = "intercept"
_FEWEST_OBJECTS = 3

_PRIOR = 2.0
"""Standard deviation of the priors, of fixed effects in log odds and of the logarithm of random
effects' standard deviations: wide beside effects that occur."""


@dataclass(frozen=True, slots=True)
class OddsRatio:
    """A fixed effect: the factor by which the odds to hold change."""

    name: str
    value: float
    low: float
    high: float
    """`low` and `high`: bounds of the 95 % interval for other objects, with the same seeds."""


@dataclass(frozen=True, slots=True)
class MixedModel:
    """Fixed effects and the standard deviations of random effects."""

    odds_ratios: tuple[OddsRatio, ...]
    deviations: dict[str, float]
    """Standard deviation of each kind of random effect, in log odds. Small ones are too small: of
    effects on an object with 0.8 and 0.5, twelve simulated studies of 40 objects found 0.46 and
    0.17. Large ones are right."""


def fit_mixed_model(rows: Sequence[Row], estimator: str, reference: str) -> MixedModel:
    """Fit success to estimator, touches, their product and hand.

    ``logit P(held) = b0 + b1 e + b2 t + b3 e t + hand + u_object + v_object e + w_seed``. For the
    estimator e is 1, for the reference 0; t is the binary logarithm of touches, less its mean.
    So b1 is the effect at the mean of t on a typical object. u, v and w are normal; v lets the
    effect differ between objects. Each hand has its own seeds.

    Mean-field variational Bayes by ``statsmodels.BinomialBayesMixedGLM``: its means are good, its
    intervals too narrow, because it takes effects as independent. The intervals are therefore those
    of the jackknife over objects (Efron and Stein 1981). Needs ``lis-grasp[study]``.

    Parameters
    ----------
    rows
        Rows of a study; those of other estimators are left out.
    estimator, reference
        Names of the two estimators.

    Raises
    ------
    InvalidOptionError
        If there are fewer than three objects, or all trials end alike, also without one object.
    """
    used = [row for row in rows if row["estimator"] in (estimator, reference)]
    _require_fit_possible(used)
    design = _Design.of(used, estimator)
    means, deviations = design.fit(np.ones(len(used), dtype=bool))
    objects = design.random["object"].argmax(axis=1)
    count = int(objects.max()) + 1
    without = np.array([design.fit(objects != number)[0] for number in range(count)])
    variances = (count - 1) / count * np.sum((without - without.mean(axis=0)) ** 2, axis=0)
    half = student.ppf(0.975, count - 1) * np.sqrt(variances)
    ratios = tuple(
        OddsRatio(name, *np.exp([mean, mean - width, mean + width]).tolist())
        for name, mean, width in zip(design.fixed, means, half, strict=True)
        if name != _INTERCEPT
    )
    return MixedModel(ratios, dict(zip(design.random, deviations.tolist(), strict=True)))


def _require_fit_possible(rows: Sequence[Row]) -> None:
    names = {row["object"] for row in rows}
    if len(names) < _FEWEST_OBJECTS:
        raise InvalidOptionError(
            f"a mixed model needs rows of {_FEWEST_OBJECTS} objects or more; it got {len(names)}",
            option="rows",
        )
    for left_out in sorted(names):
        if len({bool(row["held"]) for row in rows if row["object"] != left_out}) < 2:
            raise InvalidOptionError(
                "a mixed model needs trials that end differently, also without one of the objects;"
                f" without {left_out} all end alike: add objects or seeds",
                option="rows",
            )


@dataclass(frozen=True, slots=True, eq=False)
class _Design:
    """Columns of a model, each of shape (N,), or (N, levels) for random effects."""

    held: FloatArray
    fixed: dict[str, FloatArray]
    random: dict[str, FloatArray]

    @classmethod
    def of(cls, rows: Sequence[Row], estimator: str) -> _Design:
        """Return the columns of the rows of two estimators."""
        ours = np.array([float(row["estimator"] == estimator) for row in rows])
        touches = np.log2([row["touches"] for row in rows])
        touches -= touches.mean()
        hands = sorted({row["hand"] for row in rows})[1:]
        fixed = {
            _INTERCEPT: np.ones(len(rows)),
            estimator: ours,
            "touches, twice as many": touches,
            f"{estimator} and touches, twice as many": ours * touches,
            **{hand: np.array([float(row["hand"] == hand) for row in rows]) for hand in hands},
        }
        objects = _indicators(numbered([row["object"] for row in rows]))
        seeds = _indicators(numbered([(row["hand"], row["seed"]) for row in rows]))
        random = {"object": objects, "effect on an object": objects * ours[:, None], "seed": seeds}
        held = np.array([float(row["held"]) for row in rows])
        return cls(held, fixed, random)

    def fit(self, chosen: BoolArray) -> tuple[FloatArray, FloatArray]:
        """Fit some rows (N,); return means of the fixed effects, deviations of the random ones."""
        with needed_package("statsmodels", "study"):
            from statsmodels.genmod.bayes_mixed_glm import BinomialBayesMixedGLM
        random = [each[chosen] for each in self.random.values()]
        random = [each[:, each.any(axis=0)] for each in random]
        kinds = np.repeat(np.arange(len(random)), [each.shape[1] for each in random])
        fixed = np.column_stack(list(self.fixed.values()))[chosen]
        model = BinomialBayesMixedGLM(
            self.held[chosen], fixed, np.hstack(random), kinds, vcp_p=_PRIOR, fe_p=_PRIOR
        )
        # The default start is random.
        start = np.zeros(fixed.shape[1] + len(random) + len(kinds))
        found = model.fit_vb(mean=start, sd=np.ones_like(start))
        return found.fe_mean, np.exp(found.vcp_mean)


def _indicators(numbers: IntArray) -> FloatArray:
    """Return a column of 0 and 1 for each number from 0."""
    return np.asarray(numbers[:, None] == np.arange(numbers.max() + 1), dtype=np.float64)
