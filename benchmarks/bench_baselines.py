"""Our estimators beside what one would pick from scikit-learn and SciPy: errors and time.

    pip install lis-grasp[baselines]
    python benchmarks/bench_baselines.py --seeds 3

The two general-purpose interpolators know no normals, so they are given what is usual in their
place: besides value 0 at each contact, values +h and -h at points h along and against its normal,
h a quarter of the contacts' spacing. scikit-learn's length scale is chosen by its marginal
likelihood, SciPy's thin plate has none. Contacts are those of benchmarks/bench_surfaces.py.
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Callable

import numpy as np
from scipy.interpolate import RBFInterpolator
from sklearn.gaussian_process import GaussianProcessRegressor
from sklearn.gaussian_process.kernels import RBF, WhiteKernel

from lis_grasp import Contacts, Hand, ImplicitSurface, extract_mesh, shapes, surface_error
from lis_grasp.pipeline import STEP_FRACTION, touch
from lis_grasp.surfaces import ESTIMATORS

_OFFSET = 0.25
_MEASURES = ("rmsd", "rmsd_truth_to_estimate", "edge_rmsd")


class OffsetSurface:
    """An interpolator of values at contacts and beside them, as an implicit surface."""

    def __init__(self, contacts: Contacts, fit: Callable) -> None:
        self._contacts = contacts
        margin = contacts.spacing
        self.bounds = contacts.bounds + margin * np.array([[-1.0], [1.0]])
        self._middle, self._scale = contacts.bounds.mean(axis=0), contacts.extent
        h = _OFFSET * contacts.spacing
        points = np.vstack([contacts.points + s * contacts.normals for s in (0.0, h, -h)])
        values = np.repeat([0.0, h, -h], len(contacts)) / self._scale
        self._predict = fit((points - self._middle) / self._scale, values)

    def evaluate(self, points: np.ndarray) -> np.ndarray:
        rows = (np.reshape(points, (-1, 3)) - self._middle) / self._scale
        return self._scale * self._predict(rows).reshape(np.shape(points)[:-1])

    def gradient(self, points: np.ndarray) -> np.ndarray:
        h = 1e-4 * self._scale
        steps = h * np.eye(3)
        return np.stack(
            [(self.evaluate(points + s) - self.evaluate(points - s)) / (2.0 * h) for s in steps],
            axis=-1,
        )

    def uncertainty(self, points: np.ndarray) -> np.ndarray:
        gaps = np.linalg.norm(np.asarray(points)[..., None, :] - self._contacts.points, axis=-1)
        return gaps.min(axis=-1)


def scikit_learn(contacts: Contacts) -> ImplicitSurface:
    def fit(points: np.ndarray, values: np.ndarray) -> Callable:
        kernel = RBF(0.4, (0.1, 2.0)) + WhiteKernel(1e-6, (1e-9, 1e-2))
        # Values minus the prior mean of one length outside, as in our GPIS.
        process = GaussianProcessRegressor(kernel).fit(points, values - 1.0)
        return lambda x: process.predict(x) + 1.0

    return OffsetSurface(contacts, fit)


def thin_plate(contacts: Contacts) -> ImplicitSurface:
    return OffsetSurface(contacts, RBFInterpolator)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--seeds", type=int, default=3)
    arguments = parser.parse_args()
    contenders = {**ESTIMATORS, "scikit-learn": scikit_learn, "scipy": thin_plate}
    hand = Hand.load("allegro")
    errors: dict[str, list[list[float]]] = {name: [] for name in contenders}
    seconds: dict[str, list[float]] = {name: [] for name in contenders}
    for shape_name in shapes.NAMES:
        shape = shapes.build(shape_name, size=shapes.PAPER_SIZE)
        for seed in range(arguments.seeds):
            contacts = touch(shape, hand, estimator="gpis", touches=40, seed=seed).contacts
            for name, estimator in contenders.items():
                start = time.perf_counter()
                mesh = extract_mesh(estimator(contacts))
                seconds[name].append(time.perf_counter() - start)
                error = surface_error(
                    mesh, shape, contacts, explored_radius=STEP_FRACTION * shape.size
                )
                values = [getattr(error, measure) for measure in _MEASURES]
                errors[name].append([np.nan if v is None else 1e3 * v for v in values])
        print(f"{shape_name} done", flush=True)
    print("mean over objects and seeds, mm: estimate -> truth, truth -> estimate, edges; seconds")
    for name in contenders:
        mean = np.nanmean(errors[name], axis=0)
        print(
            f"{name:14s}" + "".join(f"{v:8.2f}" for v in mean) + f"{np.mean(seconds[name]):10.2f}"
        )


if __name__ == "__main__":
    main()
