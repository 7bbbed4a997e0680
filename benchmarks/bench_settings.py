"""Settings of the competitors: every one searched, on contact sets of development shapes only.

    python benchmarks/bench_settings.py                     # half an hour on one core
    python benchmarks/bench_settings.py ransac_csg --part 30

Prints for each setting the geometric mean of its errors over those of `gpis` with its defaults
(truth to estimate, estimate to truth), the number of failures and the mean time of a fit; the best
setting, by the mean of both, belongs into `COMPETITORS` of `lis_grasp_studies/estimators.py`.
"""

from functools import partial

import numpy as np

from lis_grasp_studies.contact_study.contact_sets import ContactSet, development_sets
from lis_grasp_studies.contact_study.score import score_estimate
from lis_grasp_studies.contact_study.tables import FLOOR
from lis_grasp_studies.estimators import COMPETITORS, OURS, Maker, given_noise
from lis_grasp_studies.harness.program import read_options
from lis_grasp_studies.harness.runner import single_thread


def measure(make: Maker, sets: list[ContactSet]) -> tuple[np.ndarray, int, float]:
    """Return errors (S, 2) in sizes of the objects, the failures and the mean seconds of a fit."""
    scores = [score_estimate(given_noise(make), data) for data in sets]
    errors = [
        (s.truth_to_estimate / data.shape.size, s.estimate_to_truth / data.shape.size)
        for s, data in zip(scores, sets, strict=True)
    ]
    failures = sum(bool(s.failure) for s in scores)
    return np.array(errors), failures, float(np.mean([s.fit_seconds for s in scores]))


def main() -> None:
    options = read_options(__doc__, objects=list(COMPETITORS), part=10)
    with single_thread():
        sets = list(development_sets(options.part))
        print(f"{len(sets)} sets", flush=True)
        reference, _, _ = measure(OURS["gpis"], sets)
        for name in options.objects:
            competitor = COMPETITORS[name]
            for settings in competitor.searched:
                errors, failures, seconds = measure(partial(competitor.make, **settings), sets)
                ratios = np.exp(np.log((errors + FLOOR) / (reference + FLOOR)).mean(axis=0))
                print(
                    f"{name:12s} {np.sqrt(ratios.prod()):6.3f}  {ratios[0]:6.3f} {ratios[1]:6.3f}"
                    f"  {failures:3d} failures  {seconds:6.3f} s  {dict(settings)}",
                    flush=True,
                )


if __name__ == "__main__":
    main()
