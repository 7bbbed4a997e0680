"""Random unit vectors for tests."""

from __future__ import annotations

import numpy as np

from lis_grasp.typing import FloatArray


def random_directions(count: int, rng: np.random.Generator) -> FloatArray:
    """Return unit vectors (count, 3) of a uniform distribution over the sphere."""
    vectors = rng.normal(size=(count, 3))
    return vectors / np.linalg.norm(vectors, axis=1, keepdims=True)
