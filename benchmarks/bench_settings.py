"""Settings of the competitors: every one searched, on contact sets of development shapes only.

    python benchmarks/bench_settings.py                     # half an hour on one core
    python benchmarks/bench_settings.py ransac_csg --part 30

Prints for each setting the geometric mean of its errors over those of `gpis` with its defaults
(truth to estimate, estimate to truth), the number of failures and the mean time of a fit; the best
setting, by the mean of both, belongs into `CHOSEN` of
`lis_grasp_studies/contact_study/competitors.py`.
"""

from __future__ import annotations

import argparse

import numpy as np
from threadpoolctl import threadpool_limits

from lis_grasp_studies.compared_estimators import NoisyEstimator
from lis_grasp_studies.contact_study.competitors import (
    SEARCHED,
    studied_estimator,
    with_settings,
)
from lis_grasp_studies.contact_study.error_ratios import FLOOR
from lis_grasp_studies.contact_study.estimate_score import score_estimate
from lis_grasp_studies.contact_study.study_sets import ContactSet, development_sets


def measure(estimator: NoisyEstimator, sets: list[ContactSet]) -> tuple[np.ndarray, int, float]:
    """Return errors (S, 2) in sizes of the objects, the failures and the mean seconds of a fit."""
    scores = [score_estimate(estimator, data) for data in sets]
    errors = [
        (s.truth_to_estimate / data.shape.size, s.estimate_to_truth / data.shape.size)
        for s, data in zip(scores, sets, strict=True)
    ]
    failures = sum(bool(s.failure) for s in scores)
    return np.array(errors), failures, float(np.mean([s.fit_seconds for s in scores]))


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("names", nargs="*", default=list(SEARCHED))
    parser.add_argument("--part", type=int, default=10, help="each shape meets one case of so many")
    options = parser.parse_args()
    with threadpool_limits(1):
        sets = list(development_sets(part=options.part))
        print(f"{len(sets)} sets", flush=True)
        reference, _, _ = measure(studied_estimator("gpis"), sets)
        for name in options.names:
            for settings in SEARCHED[name]:
                errors, failures, seconds = measure(with_settings(name, settings), sets)
                ratios = np.exp(np.log((errors + FLOOR) / (reference + FLOOR)).mean(axis=0))
                print(
                    f"{name:12s} {np.sqrt(ratios.prod()):6.3f}  {ratios[0]:6.3f} {ratios[1]:6.3f}"
                    f"  {failures:3d} failures  {seconds:6.3f} s  {dict(settings)}",
                    flush=True,
                )


if __name__ == "__main__":
    main()
