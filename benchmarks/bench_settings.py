"""Settings of the competitors: every one searched, on contact sets of development shapes only.

    python benchmarks/bench_settings.py                     # half an hour on one core
    python benchmarks/bench_settings.py ransac_csg --part 30
    python benchmarks/bench_settings.py poisson apss thin_plate --touched 24

Prints for each setting the geometric mean of its errors over those of `gpis` with its defaults
(truth to estimate, estimate to truth), the number of failures and the mean time of a fit; the best
setting, by the mean of both, belongs into `COMPETITORS` of `lis_grasp_studies/estimators.py`.

With `--touched`, contacts are from 20 and 40 touches, as in the touch benchmark, of objects of its
families and of another salt.
"""

from functools import partial

import numpy as np

from lis_grasp_studies.benchmark.objects import GUIDE
from lis_grasp_studies.contact_study.contact_sets import (
    ContactCase,
    ContactSet,
    development_sets,
)
from lis_grasp_studies.contact_study.score import score_estimate
from lis_grasp_studies.contact_study.tables import FLOOR
from lis_grasp_studies.estimators import COMPETITORS, OURS, Maker, Noise, given_noise
from lis_grasp_studies.evaluation.touched_shapes import COUNTS, NOISE, touched
from lis_grasp_studies.harness.program import read_options
from lis_grasp_studies.harness.runner import single_thread
from lis_grasp_studies.test_objects.salted import MIXED_FAMILIES, salted_shape

_SALT = "development"  # of touched objects; the benchmark's is another


def touched_sets(count: int) -> list[ContactSet]:
    """Return contact sets as those of the touch benchmark, of objects that are not in it."""
    sets = []
    for number in range(count):
        shape = salted_shape(_SALT, number, MIXED_FAMILIES)
        contacts = touched(shape, 0, estimator=GUIDE)
        for few in COUNTS:
            first = contacts[:few]
            case = ContactCase("uncertainty", few)
            sets.append(ContactSet(shape, shape.name, case, 0, first, first))
    return sets


def measure(
    make: Maker, sets: list[ContactSet], noise: Noise | None
) -> tuple[np.ndarray, int, float]:
    """Return errors (S, 2) in sizes of the objects, the failures and the mean seconds of a fit.

    The noise is given to the estimator, or that of each set.
    """
    fit = given_noise(make)
    scores = [score_estimate(lambda c, of_set: fit(c, noise or of_set), data) for data in sets]
    errors = [
        (s.truth_to_estimate / data.shape.size, s.estimate_to_truth / data.shape.size)
        for s, data in zip(scores, sets, strict=True)
    ]
    failures = sum(bool(s.failure) for s in scores)
    return np.array(errors), failures, float(np.mean([s.fit_seconds for s in scores]))


def main() -> None:
    options = read_options(__doc__, objects=list(COMPETITORS), part=10, touched=0)
    noise = Noise(NOISE["position_noise"], NOISE["normal_noise"]) if options.touched else None
    with single_thread():
        sets = touched_sets(options.touched) or list(development_sets(options.part))
        print(f"{len(sets)} sets", flush=True)
        reference, _, _ = measure(OURS["gpis"], sets, noise)
        for name in options.objects:
            competitor = COMPETITORS[name]
            for settings in competitor.searched:
                errors, failures, seconds = measure(
                    partial(competitor.make, **settings), sets, noise
                )
                ratios = np.exp(np.log((errors + FLOOR) / (reference + FLOOR)).mean(axis=0))
                print(
                    f"{name:12s} {np.sqrt(ratios.prod()):6.3f}  {ratios[0]:6.3f} {ratios[1]:6.3f}"
                    f"  {failures:3d} failures  {seconds:6.3f} s  {dict(settings)}",
                    flush=True,
                )


if __name__ == "__main__":
    main()
