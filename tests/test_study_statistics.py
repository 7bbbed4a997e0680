"""Statistics of studies against closed forms, enumeration, and another implementation."""

from __future__ import annotations

from itertools import product
from math import comb

import numpy as np
import pytest
from scipy import stats

from lis_grasp.study.comparison import agreements, compare, losses, measure_table
from lis_grasp.study.statistics import (
    clustered,
    holm,
    mcnemar,
    rank_biserial,
    sign_flip_p_value,
    wilcoxon,
)

ROUNDING = 1e-12  # sums of at most some thousand probabilities


def test_mcnemar_is_the_binomial_tail() -> None:
    # 8 of 10: 2 (C(10,0) + C(10,1) + C(10,2)) / 2^10.
    tail = 2 * (comb(10, 0) + comb(10, 1) + comb(10, 2)) / 2**10
    assert mcnemar(8, 2) == pytest.approx(tail, rel=ROUNDING)
    assert mcnemar(2, 8) == mcnemar(8, 2)
    assert mcnemar(4, 4) == 1.0
    assert mcnemar(0, 0) == 1.0
    assert mcnemar(60, 17) == pytest.approx(stats.binomtest(17, 77).pvalue, rel=1e-9)


def test_wilcoxon_without_ties_is_scipy_s_exact_test() -> None:
    rng = np.random.default_rng(0)
    for count in (1, 5, 23):
        differences = rng.normal(0.3, 1.0, count)
        exact = stats.wilcoxon(differences, method="exact").pvalue
        assert wilcoxon(differences) == pytest.approx(exact, rel=1e-9)


def test_wilcoxon_with_ties_is_the_share_of_all_signs() -> None:
    differences = np.array([1.0, 1.0, -1.0, 2.0, 2.0, 3.0, -0.5, 0.0])
    ranks = stats.rankdata(np.abs(differences[differences != 0]))
    observed = abs(ranks @ np.sign(differences[differences != 0]))
    sums = [abs(ranks @ signs) for signs in product([-1, 1], repeat=len(ranks))]
    share = np.mean([s >= observed for s in sums])
    assert wilcoxon(differences) == pytest.approx(share, rel=ROUNDING)
    assert wilcoxon([0.0, 0.0]) == 1.0
    assert wilcoxon([]) == 1.0


def test_under_no_difference_p_is_small_no_more_often_than_it_says() -> None:
    # All 2^8 signs of eight different weights: the share with p <= alpha is at most alpha.
    weights = np.array([1, 2, 3, 4, 5, 6, 7, 8])
    p = np.array([sign_flip_p_value(weights, int(weights @ s)) for s in product([-1, 1], repeat=8)])
    for alpha in (0.01, 0.05, 0.2, 0.5):
        assert (p <= alpha).mean() <= alpha
    assert p.min() == pytest.approx(2 / 2**8)


def test_clusters_of_one_are_mcnemar_s_test_and_copies_add_no_evidence() -> None:
    signs = np.array([1] * 9 + [-1] * 2 + [0] * 5)
    assert clustered(signs) == pytest.approx(mcnemar(9, 2), rel=ROUNDING)
    # Each pair three times, in one cluster: the same p; taken as independent, far too small.
    assert clustered(3 * signs) == pytest.approx(mcnemar(9, 2), rel=ROUNDING)
    assert mcnemar(27, 6) < 0.05 * mcnemar(9, 2)


def test_rank_biserial_is_the_balance_of_ranks() -> None:
    assert rank_biserial([1.0, 2.0, 3.0]) == 1.0
    assert rank_biserial([-1.0, -2.0]) == -1.0
    # Ranks 1, 2, 3 of 6; only the largest is negative.
    assert rank_biserial([0.1, 0.2, -0.3]) == pytest.approx((1 + 2 - 3) / 6)
    assert rank_biserial([0.0]) == 0.0


def test_holm_steps_down_and_never_goes_back() -> None:
    # Holm's steps: 3 x .01, max(.03, 2 x .02), max(.04, 1 x .03).
    np.testing.assert_allclose(holm([0.03, 0.01, 0.02]), [0.04, 0.03, 0.04])
    np.testing.assert_array_equal(holm([0.6, 0.9]), [1.0, 1.0])
    assert holm([]).shape == (0,)


def study_rows(
    held: dict[str, list[int]], *, edged: bool = True, rmsd: dict[str, float] | None = None
) -> list[dict]:
    return [
        {
            "object": "box",
            "edged": edged,
            "hand": "allegro",
            "touches": 10,
            "noise": "none",
            "seed": seed,
            "estimator": name,
            "held": bool(yes),
            "epsilon_truth": 0.1 if yes else None,
            "epsilon_gap": None,
            "rmsd": (rmsd or {}).get(name),
            "rmsd_truth_to_estimate": None,
            "edge_rmsd": None,
        }
        for name, trials in held.items()
        for seed, yes in enumerate(trials)
    ]


def test_the_risk_difference_is_that_of_the_pairs() -> None:
    rows = study_rows({"gpis": [0, 0, 0, 1, 1], "blend": [1, 1, 1, 1, 0]}, rmsd={"gpis": 2e-3})
    found = {c.measure: c for c in compare(rows, "gpis")}
    held = found["held"]
    assert (held.wins, held.losses, held.pairs) == (3, 1, 5)
    assert held.effect == pytest.approx(0.8 - 0.4)
    assert held.low is not None
    assert held.high is not None
    assert held.low < held.effect < held.high
    assert held.p == pytest.approx(mcnemar(3, 1))
    assert held.rank_biserial is None
    # No grasp has an epsilon of 0; a surface error that one lacks is compared for neither.
    assert found["epsilon_truth"].effect == pytest.approx(0.1 * 0.4)
    assert set(found) == {"held", "epsilon_truth"}


def test_smaller_errors_are_wins() -> None:
    rows = study_rows(
        {"gpis": [1] * 6, "blend": [1] * 6}, rmsd={"gpis": 3e-3, "blend": 1e-3}, edged=False
    )
    (rmsd,) = [c for c in compare(rows, "gpis") if c.measure == "rmsd"]
    assert (rmsd.wins, rmsd.losses, rmsd.kind) == (6, 0, "curved")
    assert rmsd.effect == pytest.approx(-2e-3)
    assert rmsd.rank_biserial == 1.0
    assert rmsd.p == pytest.approx(2 / 2**6)


def test_p_values_are_adjusted_over_all_comparisons() -> None:
    rows = study_rows({"gpis": [0] * 8, "blend": [1] * 8, "lis": [1] * 8, "truth": [1] * 8})
    found = compare(rows, "gpis")
    # held and epsilon_truth for two estimators: four equal p-values, each times 4; truth is none.
    assert {c.estimator for c in found} == {"blend", "lis"}
    assert [c.p_holm for c in found] == pytest.approx([4 * 2 / 2**8] * 4)


def test_losses_are_pairs_that_only_the_reference_held() -> None:
    rows = study_rows({"gpis": [1, 0, 1], "blend": [1, 0, 0], "lis": [0, 1, 1]})
    found = [(mine["estimator"], mine["seed"]) for mine, _ in losses(rows, "gpis")]
    assert found == [("blend", 2), ("lis", 0)]
    assert all(
        theirs["estimator"] == "gpis" and theirs["held"] for _, theirs in losses(rows, "gpis")
    )


def test_measures_are_told_apart_by_noise_and_kind() -> None:
    rows = study_rows({"gpis": [1, 0]}) + study_rows({"gpis": [1, 1]}, edged=False)
    assert measure_table(rows, "held", kind="edged", noise="none").overall("gpis") == 0.5
    assert measure_table(rows, "held", kind="curved", noise="none").overall("gpis") == 1.0


def test_too_few_seeds_have_no_interval() -> None:
    (held, _) = compare(study_rows({"gpis": [0, 1], "blend": [1, 1]}), "gpis")
    assert (held.effect, held.low, held.high) == (0.5, None, None)


def test_agreement_counts_pairs_of_which_the_nearer_surface_held() -> None:
    # Two pairs are split; of both lis has the larger error, and holds one.
    held = {"gpis": [1, 0, 1], "lis": [0, 1, 1]}
    rows = study_rows(held, rmsd={"gpis": 1e-3, "lis": 2e-3})
    (found,) = agreements(rows, "gpis")
    assert (found.measure, found.agree, found.disagree, found.p) == ("rmsd", 1, 1, 1.0)
    assert not agreements(study_rows({"gpis": [1], "lis": [0]}), "gpis")
