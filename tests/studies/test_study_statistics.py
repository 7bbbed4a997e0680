"""Statistics of studies against closed forms, enumeration, and another implementation."""

from __future__ import annotations

from itertools import product
from math import comb

import numpy as np
import pytest
from scipy import stats

from lis_grasp.typing import FloatArray
from lis_grasp_studies.harness.statistics import (
    bootstrap_interval,
    cluster_sums,
    clusters_of,
    crossed_interval,
    detectable_difference,
    equivalence_p_value,
    holm,
    interval_over_objects,
    interval_over_seeds,
    rank_biserial,
    sign_flip_p_value,
    signed_ranks,
    success_rate,
)
from lis_grasp_studies.study.comparison import agreements, compare, compare_held, losses

pytest.importorskip("statsmodels", reason="needs lis-grasp[study]")

ROUNDING = 1e-12  # sums of at most some thousand probabilities


def mcnemar(wins: int, losses: int) -> float:
    return sign_flip_p_value([1] * wins + [-1] * losses)


def test_flips_of_single_pairs_are_the_binomial_tail_of_mcnemar_s_test() -> None:
    # 8 of 10: 2 (C(10,0) + C(10,1) + C(10,2)) / 2^10.
    tail = 2 * (comb(10, 0) + comb(10, 1) + comb(10, 2)) / 2**10
    assert mcnemar(8, 2) == pytest.approx(tail, rel=ROUNDING)
    assert mcnemar(2, 8) == mcnemar(8, 2)
    assert mcnemar(4, 4) == 1.0
    assert mcnemar(0, 0) == 1.0
    assert mcnemar(60, 17) == pytest.approx(stats.binomtest(17, 77).pvalue, rel=1e-9)


def test_flips_of_signed_ranks_without_ties_are_scipy_s_exact_test_of_wilcoxon() -> None:
    rng = np.random.default_rng(0)
    for count in (1, 5, 23):
        differences = rng.normal(0.3, 1.0, count)
        exact = stats.wilcoxon(differences, method="exact").pvalue
        assert sign_flip_p_value(signed_ranks(differences)) == pytest.approx(exact, rel=1e-9)


def test_flips_of_signed_ranks_with_ties_match_enumeration() -> None:
    differences = np.array([1.0, 1.0, -1.0, 2.0, 2.0, 3.0, -0.5, 0.0])
    ranks = stats.rankdata(np.abs(differences[differences != 0]))
    observed = abs(ranks @ np.sign(differences[differences != 0]))
    sums = [abs(ranks @ signs) for signs in product([-1, 1], repeat=len(ranks))]
    fraction = np.mean([s >= observed for s in sums])
    assert sign_flip_p_value(signed_ranks(differences)) == pytest.approx(fraction, rel=ROUNDING)
    assert sign_flip_p_value(signed_ranks([0.0, 0.0])) == 1.0
    assert sign_flip_p_value([]) == 1.0


def test_p_values_under_no_difference_are_valid() -> None:
    # All 2^8 signs of eight different weights: the fraction with p <= alpha is at most alpha.
    weights = np.array([1, 2, 3, 4, 5, 6, 7, 8])
    p = np.array([sign_flip_p_value(weights * s) for s in product([-1, 1], repeat=8)])
    for alpha in (0.01, 0.05, 0.2, 0.5):
        assert (p <= alpha).mean() <= alpha
    assert p.min() == pytest.approx(2 / 2**8)


def test_many_summands_are_normal(monkeypatch: pytest.MonkeyPatch) -> None:
    ranks = signed_ranks(np.random.default_rng(2).normal(0.1, 1.0, 400))
    exact = sign_flip_p_value(ranks)
    assert 0.001 < exact < 0.2
    monkeypatch.setattr("lis_grasp_studies.harness.statistics._MOST_EXACT", 100)
    assert sign_flip_p_value(ranks) == pytest.approx(exact, rel=0.02)
    assert sign_flip_p_value(ranks) != exact


def test_copies_in_a_cluster_add_no_evidence() -> None:
    signs = np.array([1] * 9 + [-1] * 2 + [0] * 5)
    # Each pair three times, in one cluster: the same p; taken as independent, far too small.
    assert sign_flip_p_value(3 * signs) == pytest.approx(mcnemar(9, 2), rel=ROUNDING)
    assert mcnemar(27, 6) < 0.05 * mcnemar(9, 2)
    # So with ranks: nearly the same weights (3 r - 1 for r).
    differences = np.random.default_rng(1).normal(0.4, 1.0, 15).round(1)
    thrice = signed_ranks(np.repeat(differences, 3))
    alone = sign_flip_p_value(signed_ranks(differences))
    together = sign_flip_p_value(cluster_sums(thrice, np.repeat(np.arange(15), 3)))
    assert together == pytest.approx(alone, rel=0.1)
    assert sign_flip_p_value(thrice) < 0.1 * alone


def test_cluster_tests_keep_their_error_rate_and_pair_tests_do_not() -> None:
    # No estimator is better, but pairs of a cluster agree: 20 clusters of 8 pairs.
    rng = np.random.default_rng(0)
    clusters = np.repeat(np.arange(20), 8)
    errs = []
    for _ in range(400):
        lean = rng.normal(0.0, 1.5, 20)[clusters]
        signs = np.where(rng.random(160) < 1.0 / (1.0 + np.exp(-lean)), 1, -1)
        p = sign_flip_p_value(cluster_sums(signs, clusters)), sign_flip_p_value(signs)
        errs.append([value <= 0.05 for value in p])
    together, alone = np.mean(errs, axis=0)
    # Three standard deviations of a rate of 5 % in 400 are 3.3 points.
    assert together <= 0.05 + 0.033
    assert alone > 0.15


def test_bootstrap_intervals_are_normal_for_many_clusters_and_ignore_copies() -> None:
    rng = np.random.default_rng(0)
    values = rng.normal(2.0, 1.0, 400)
    low, high = bootstrap_interval(values, np.arange(400), rng=rng)
    # 1.96 / sqrt(400) each way; ends of 4000 resamples are known to a twentieth of that.
    assert high - low == pytest.approx(2 * 1.96 * values.std() / 20.0, rel=0.05)
    assert low < values.mean() < high
    # Each value four times, in a cluster: as wide as without the copies.
    copied = bootstrap_interval(np.repeat(values, 4), np.repeat(np.arange(400), 4), rng=rng)
    np.testing.assert_allclose(copied, (low, high), atol=0.01)


def test_crossed_intervals_are_student_s_intervals_of_the_means() -> None:
    rng = np.random.default_rng(0)
    table = 10.0 * np.arange(12)[:, None] + rng.normal(0.0, 1.0, (12, 6)) + rng.normal(size=6)
    kept, drawn = (index.ravel() for index in np.indices(table.shape))
    interval = stats.ttest_1samp(table.mean(axis=0), 0.0).confidence_interval(0.95)
    found = crossed_interval(table.ravel(), drawn, kept)
    np.testing.assert_allclose(found, (interval.low, interval.high), rtol=1e-12)
    # Far apart as objects are, a value that is missing does not widen it much.
    some = np.arange(72) != 40
    low, high = crossed_interval(table.ravel()[some], drawn[some], kept[some])
    assert low is not None
    assert high is not None
    assert high - low == pytest.approx(interval.high - interval.low, rel=0.2)
    # With a quarter of them missing there is no interval.
    some = np.arange(72) % 4 != 0
    assert crossed_interval(table.ravel()[some], drawn[some], kept[some]) == (None, None)


def test_the_levels_of_a_nested_factor_do_not_widen_the_interval_over_seeds() -> None:
    # Seeds 0 to 2 with one hand and 3 to 6 with another: a hand's ease is not a seed's.
    values = np.random.default_rng(0).random((7, 12))
    first = np.arange(7) < 3
    rows = [
        {"object": o, "seed": s, "hand": "ab"[int(first[s])]} for s in range(7) for o in range(12)
    ]
    low, high = interval_over_seeds(rows, values.ravel())
    eased = values + 5.0 * first[:, None] + 3.0 * np.arange(12) * ~first[:, None]
    eased_low, eased_high = interval_over_seeds(rows, eased.ravel())
    assert None not in (low, high, eased_low, eased_high)
    assert eased_high - eased_low == pytest.approx(high - low, rel=1e-9)  # type: ignore[operator]
    # The pooled variance of two samples, as in Student's test for two means.
    means = values.mean(axis=1)
    pooled = 2.0 * means[first].var(ddof=1) + 3.0 * means[~first].var(ddof=1)
    width = 2.0 * stats.t.ppf(0.975, 5) * np.sqrt(pooled / 5.0 / 7.0)
    assert high - low == pytest.approx(width, rel=1e-9)  # type: ignore[operator]


def simulated(
    odds: FloatArray, luck: float, seeds: int, rng: np.random.Generator
) -> tuple[list[dict], FloatArray]:
    """Return trials of objects with given odds, with luck common to the objects of a seed."""
    logits = odds[:, None] + luck * rng.normal(size=seeds) + 0.7 * rng.normal(size=(6, seeds))
    held = rng.random((6, seeds, 8)) < 1.0 / (1.0 + np.exp(-logits))[:, :, None]
    rows = [{"object": o, "seed": s} for o in range(6) for s in range(seeds) for _ in range(8)]
    return rows, held.ravel().astype(float)


@pytest.mark.slow
@pytest.mark.parametrize("luck", [0.0, 0.7])
def test_intervals_over_seeds_have_their_coverage(luck: float) -> None:
    # 6 objects, some easy, some hard, 4 seeds, with and without luck common to all objects.
    rng = np.random.default_rng(0)
    objects = np.linspace(-3.0, 4.0, 6)
    draws = objects + np.hypot(luck, 0.7) * rng.normal(size=(100_000, 1))
    truth = (1.0 / (1.0 + np.exp(-draws))).mean()
    covered, covered_in_pairs = [], []
    for _ in range(500):
        rows, held = simulated(objects, luck, 4, rng)
        low, high = interval_over_seeds(rows, held)
        assert low is not None
        assert high is not None
        covered.append(low <= truth <= high)
        low, high = bootstrap_interval(held, clusters_of(rows), rng=rng)
        covered_in_pairs.append(low <= truth <= high)
    # Three standard deviations of a rate of 95 % in 500 are 2.9 points.
    assert np.mean(covered) == pytest.approx(0.95, abs=0.029)
    # Pairs of object and seed are too wide, because objects differ; or too narrow, had they less
    # to differ by, because seeds have luck.
    assert np.mean(covered_in_pairs) > 0.97 or luck > 0.0


def test_intervals_over_objects_do_not_narrow_with_seeds() -> None:
    rates = np.random.default_rng(0).random(12)

    def widths(seeds: int) -> tuple[float, float]:
        rng = np.random.default_rng(1)
        rows = [{"object": o, "seed": s} for o in range(12) for s in range(seeds)]
        values = [float(rng.random() < rates[row["object"]]) for row in rows]
        found = []
        for low, high in (interval_over_seeds(rows, values), interval_over_objects(rows, values)):
            assert low is not None
            assert high is not None
            found.append(high - low)
        return found[0], found[1]

    of_seeds, of_objects = np.array(widths(400)) / np.array(widths(20))
    assert of_seeds == pytest.approx(np.sqrt(20 / 400), rel=0.35)
    assert of_objects > 0.7


def test_seeds_that_never_differ_leave_an_interval() -> None:
    # Ten objects that always hold and two that never do, whatever the seed.
    rows = [{"object": o, "seed": s} for o in range(12) for s in range(5)]
    low, high = interval_over_seeds(rows, [float(row["object"] < 10) for row in rows])
    assert low is not None
    assert high is not None
    assert low < 10 / 12 < high


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
    held: dict[str, list[int]],
    *,
    edged: bool = True,
    rmsd: dict[str, float] | None = None,
    touches: int = 10,
) -> list[dict]:
    return [
        {
            "object": "box" if edged else "sphere",
            "edged": edged,
            "hand": "allegro",
            "touches": touches,
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
    gpis, blend = [0, 0, 0, 1, 1] * 2, [1, 1, 1, 1, 0] * 2
    rows = study_rows({"gpis": gpis, "blend": blend}, rmsd={"gpis": 2e-3})
    found = {c.measure: c for c in compare(rows, "gpis")}
    held = found["held"]
    assert (held.wins, held.losses, held.pairs, held.clusters) == (6, 2, 10, 10)
    assert held.effect == pytest.approx(0.8 - 0.4)
    assert held.low is not None
    assert held.high is not None
    assert held.low < held.effect < held.high
    assert held.p == pytest.approx(mcnemar(6, 2))
    # All are of one object, whose pairs flip together: no evidence about other objects.
    assert held.p_objects == 1.0
    # Each seed is one pair here.
    assert held.p_seeds == held.p
    assert held.objects_low is None
    assert held.rank_biserial is None
    # No grasp has an epsilon of 0; a surface error that one lacks is compared for neither.
    assert found["epsilon_truth"].effect == pytest.approx(0.1 * 0.4)
    assert set(found) == {"held", "epsilon_truth"}


def test_budgets_of_one_object_and_seed_are_one_cluster() -> None:
    trials = {"gpis": [0] * 6, "blend": [1] * 6}
    rows = study_rows(trials) + study_rows(trials, touches=20)
    held = compare(rows, "gpis")[0]
    assert (held.pairs, held.clusters) == (12, 6)
    assert held.p == pytest.approx(mcnemar(6, 0))
    assert held.p_holm >= held.p


def test_smaller_errors_are_wins() -> None:
    rows = study_rows(
        {"gpis": [1] * 6, "blend": [1] * 6}, rmsd={"gpis": 3e-3, "blend": 1e-3}, edged=False
    )
    (rmsd,) = [c for c in compare(rows, "gpis") if c.measure == "rmsd"]
    assert (rmsd.wins, rmsd.losses, rmsd.kind) == (6, 0, "curved")
    assert rmsd.effect == pytest.approx(-2e-3)
    assert rmsd.rank_biserial == 1.0
    assert rmsd.p == pytest.approx(2 / 2**6)


def test_p_values_are_adjusted_over_the_estimators_of_a_measure_and_kind() -> None:
    rows = study_rows({"gpis": [0] * 8, "blend": [1] * 8, "lis": [1] * 8, "truth": [1] * 8})
    found = compare(rows, "gpis")
    # Of held and of epsilon_truth two equal p-values each, each times 2; truth is no estimator.
    assert {c.estimator for c in found} == {"blend", "lis"}
    assert [c.p_holm for c in found] == pytest.approx([2 * 2 / 2**8] * 4)


def test_noises_together_are_a_family_of_their_own() -> None:
    rows = study_rows({"gpis": [0] * 8, "blend": [1] * 8, "lis": [0] * 8, "truth": [1] * 8})
    rows += [row | {"noise": "1mm"} for row in rows]
    blend, lis = compare_held(rows, "gpis")
    assert (blend.noise, blend.pairs, blend.clusters, blend.effect) == (None, 16, 8, 1.0)
    # Two noises of one object and seed are one cluster; there are two estimators to adjust for.
    assert blend.p_holm == pytest.approx(2 * 2 / 2**8)
    assert (lis.effect, lis.p_holm) == (0.0, 1.0)


def test_all_objects_come_first_where_there_are_several_kinds() -> None:
    trials = {"gpis": [0] * 6, "blend": [1] * 6}
    rows = study_rows(trials) + study_rows(trials, edged=False)
    scan = [row | {"object": "can.ply", "object_digest": "ab"} for row in study_rows(trials)]
    held = [c for c in compare(rows + scan, "gpis") if c.measure == "held"]
    assert [(c.kind, c.pairs) for c in held] == [
        ("all", 18),
        ("edged", 6),
        ("curved", 6),
        ("files", 6),
    ]
    assert [c.kind for c in compare(rows[:12], "gpis") if c.measure == "held"] == ["edged"]


def test_success_rates_have_intervals_over_objects_and_seeds() -> None:
    rows = study_rows({"gpis": [1] * 8 + [0] * 4})
    rate = success_rate(rows)
    assert rate is not None
    assert (rate.held, rate.trials, rate.clusters) == (8, 12, 12)
    assert rate.low is not None
    assert rate.high is not None
    assert rate.low < 8 / 12 < rate.high
    assert success_rate([]) is None
    few = success_rate(rows[:3])
    assert few is not None
    assert few.low is None
    # Four budgets of twelve explorations, all held: as sure as twelve trials make it, not 48.
    sure = success_rate(
        [row for n in (5, 10, 20, 40) for row in study_rows({"a": [1] * 12}, touches=n)]
    )
    assert sure is not None
    assert (sure.held, sure.trials) == (48, 48)
    wilson = stats.binomtest(12, 12).proportion_ci(method="wilson")
    assert (sure.low, sure.high) == (pytest.approx(wilson.low), pytest.approx(wilson.high))


def test_losses_are_pairs_that_only_the_reference_held() -> None:
    rows = study_rows({"gpis": [1, 0, 1], "blend": [1, 0, 0], "lis": [0, 1, 1]})
    found = [(mine["estimator"], mine["seed"]) for mine, _ in losses(rows, "gpis")]
    assert found == [("blend", 2), ("lis", 0)]
    assert all(
        theirs["estimator"] == "gpis" and theirs["held"] for _, theirs in losses(rows, "gpis")
    )


def test_too_few_clusters_have_no_interval() -> None:
    (held, _) = compare(study_rows({"gpis": [0, 1], "blend": [1, 1]}), "gpis")
    assert (held.effect, held.low, held.high) == (0.5, None, None)


def test_agreement_counts_pairs_of_which_the_nearer_surface_held() -> None:
    # Two pairs are split; of both lis has the larger error, and holds one.
    held = {"gpis": [1, 0, 1], "lis": [0, 1, 1]}
    rows = study_rows(held, rmsd={"gpis": 1e-3, "lis": 2e-3})
    (found,) = agreements(rows, "gpis")
    assert (found.measure, found.agree, found.pairs, found.p) == ("rmsd", 1, 2, 1.0)
    assert not agreements(study_rows({"gpis": [1], "lis": [0]}), "gpis")


def test_equality_is_found_where_the_interval_of_90_percent_is_within_the_margin() -> None:
    """The two tests at 5 % are equivalent to it (Schuirmann 1987); here by SciPy's interval."""
    rng, margin = np.random.default_rng(4), 0.1
    agree = []
    for _ in range(200):
        values = rng.normal(rng.uniform(-0.1, 0.1), 0.15, 21)
        ends = stats.ttest_1samp(values, 0.0).confidence_interval(0.9)
        within = -margin < float(ends.low) < float(ends.high) < margin
        agree.append((equivalence_p_value(values, margin) < 0.05) == within)
    assert all(agree)
    # No difference of n: a tenth that lose all would show none with a chance of 0.9^n.
    assert equivalence_p_value(np.zeros(21), margin) == pytest.approx(0.9**21)
    assert equivalence_p_value(np.zeros(21), 5.0, largest=40.0) == pytest.approx(0.875**21)
    assert equivalence_p_value(np.zeros(21), margin, largest=None) == 0.0
    assert equivalence_p_value(np.full(21, 0.125), 0.125) == 1.0
    assert equivalence_p_value(np.zeros(1), margin) == 1.0


@pytest.mark.parametrize("count", [12, 24, 100])
def test_a_detectable_difference_has_a_power_of_80_percent(count: int) -> None:
    from statsmodels.stats.power import TTestPower  # by the noncentral t-distribution

    values = 1.5 + 3.0 * np.random.default_rng(count).standard_normal(count)
    found = detectable_difference(values)
    assert found is not None
    size = found / float(np.std(values, ddof=1))
    # Ours is the first order: 1 point from the exact power with twelve values.
    assert TTestPower().power(size, count, 0.05) == pytest.approx(0.8, abs=0.01)
    assert detectable_difference([1.0]) is None
