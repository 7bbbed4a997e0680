import numpy as np
import pytest

from lis_grasp.exceptions import InvalidOptionError
from lis_grasp_studies.study.mixed_model import fit_mixed_model

statsmodels = pytest.importorskip("statsmodels.api", reason="needs lis-grasp[study]")
pytestmark = pytest.mark.experiments


def made_rows(effect, rng):
    """Return rows of 20 objects, whose effects and success rates differ, with two hands."""
    rows = []
    seed_effects = rng.normal(0.0, 0.2, size=6)
    for number in range(20):
        ease, more = rng.normal(0.5, 1.0), rng.normal(effect, 0.3)
        for seed, touches, ours in np.ndindex(6, 3, 2):
            x = ease + more * ours + 0.8 * (touches - 1) + seed_effects[seed]
            rows.append(
                {
                    "object": f"object {number}",
                    "hand": ("allegro", "wsg50")[seed % 2],
                    "seed": seed,
                    "touches": 10 * 2**touches,
                    "estimator": ("gpis", "blend")[ours],
                    "held": bool(rng.random() < 1.0 / (1.0 + np.exp(-x))),
                }
            )
    return rows


def test_model_finds_the_effects_that_made_the_rows():
    rows = made_rows(1.2, np.random.default_rng(5))
    model = fit_mixed_model(rows, "blend", "gpis")
    ratios = {ratio.name: ratio for ratio in model.odds_ratios}
    for name, effect in (("blend", 1.2), ("touches, twice as many", 0.8)):
        assert 1.0 < ratios[name].low < np.exp(effect) < ratios[name].high
    assert model.deviations["object"] == pytest.approx(1.0, abs=0.4)
    # An independent model: logistic regression with a constant of its own for each object.
    objects = sorted({row["object"] for row in rows})
    ours = np.array([row["estimator"] == "blend" for row in rows], dtype=float)
    touches = np.log2([row["touches"] / 20.0 for row in rows])
    columns = [ours, touches, ours * touches, [row["hand"] == "wsg50" for row in rows]]
    columns += [[row["object"] == name for row in rows] for name in objects]
    held = [float(row["held"]) for row in rows]
    family = statsmodels.families.Binomial()
    oracle = statsmodels.GLM(held, np.array(columns, dtype=float).T, family=family).fit()
    found = np.log([ratio.value for ratio in model.odds_ratios])
    assert found == pytest.approx(oracle.params[:4], abs=0.05)


def test_model_finds_no_effect_where_there_is_none():
    rows = made_rows(0.0, np.random.default_rng(3))
    (ours, *_) = fit_mixed_model(rows, "blend", "gpis").odds_ratios
    assert ours.low < 1.0 < ours.high


def test_equal_rows_give_equal_models():
    rows = made_rows(0.5, np.random.default_rng(4))[:216]
    assert fit_mixed_model(rows, "blend", "gpis") == fit_mixed_model(rows, "blend", "gpis")


def test_rows_that_cannot_be_fitted_are_refused():
    rows = made_rows(0.5, np.random.default_rng(6))
    few = [row for row in rows if row["object"] in ("object 0", "object 1")]
    with pytest.raises(InvalidOptionError, match="3 objects or more; it got 2"):
        fit_mixed_model(few, "blend", "gpis")
    alike = [row | {"held": row["object"] != "object 7"} for row in rows]
    with pytest.raises(InvalidOptionError, match="without object 7 all end alike"):
        fit_mixed_model(alike, "blend", "gpis")
