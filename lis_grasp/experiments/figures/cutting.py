"""Subdivision of lines and triangles into small pieces."""

from __future__ import annotations

import numpy as np

from lis_grasp.typing import FloatArray, IndexArray


def cut_segments(segments: FloatArray, piece: float) -> tuple[FloatArray, IndexArray]:
    """Cut each line of (S, 2, 3) in equal parts of at most `piece` [m].

    Returns the parts (P, 2, 3) [m] and the line that each was cut from (P,).
    """
    steps = segments[:, 1] - segments[:, 0]
    lengths = np.linalg.norm(steps, axis=1)
    # A line of a whole number of pieces gets no extra piece from rounding.
    counts = np.maximum(np.ceil(lengths / piece * (1.0 - 1e-9)), 1.0).astype(np.intp)
    owners = np.repeat(np.arange(len(segments)), counts)
    index = np.arange(len(owners)) - np.repeat(np.cumsum(counts) - counts, counts)
    ends = np.stack([index, index + 1], axis=1) / counts[owners][:, None]  # (P, 2), from 0 to 1
    return segments[owners, None, 0] + ends[..., None] * steps[owners, None], owners


def cut_triangles(triangles: FloatArray, piece: float) -> tuple[FloatArray, IndexArray]:
    """Halve triangles (F, 3, 3) at their longest side until none is longer than `piece` [m].

    Returns the triangles (P, 3, 3) [m] and the triangle that each was cut from (P,).
    """
    owners = np.arange(len(triangles))
    done: list[tuple[FloatArray, IndexArray]] = []
    while len(triangles):
        sides = np.linalg.norm(np.roll(triangles, -1, axis=1) - triangles, axis=2)  # k to k + 1
        long = sides.max(axis=1) > piece
        done.append((triangles[~long], owners[~long]))
        first, row = sides[long].argmax(axis=1), np.arange(long.sum())
        a, b, c = (triangles[long][row, (first + k) % 3] for k in range(3))
        middle = 0.5 * (a + b)
        triangles = np.concatenate([np.stack([a, middle, c], 1), np.stack([middle, b, c], 1)])
        owners = np.tile(owners[long], 2)
    if not done:
        return triangles, owners
    return np.concatenate([t for t, _ in done]), np.concatenate([o for _, o in done])
