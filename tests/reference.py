"""Slow and obvious versions of what the package does fast: loops straight from the formulas.

Oracles for tests, nothing else. No chunks, no trees, no shared code with the package.
"""

from __future__ import annotations

import math

import numpy as np
from scipy.sparse.csgraph import breadth_first_order, minimum_spanning_tree

from lis_grasp.typing import FloatArray


def gaussian_kernel(distance: float, sigma: float) -> float:
    """Eq. 6 of Ottenhaus et al. 2016."""
    return math.exp(-0.5 * distance**2 / sigma**2)


def density_weight(i: int, points: FloatArray, sigma: float) -> float:
    return 1.0 / sum(gaussian_kernel(math.dist(points[i], p), sigma) for p in points)


def beta_star(
    x: FloatArray, i: int, points: FloatArray, normals: FloatArray, sigma: float
) -> float:
    """Eqs. 11 to 15 at contact i towards x, by explicit angles in explicit axes."""
    normal = normals[i]
    x_axis = np.cross(normal, [1.0, 0.0, 0.0] if abs(normal[0]) < 0.6 else [0.0, 1.0, 0.0])
    x_axis = x_axis / np.linalg.norm(x_axis)
    y_axis = np.cross(normal, x_axis)

    def angle(target: FloatArray) -> float:
        offset = target - points[i]
        return math.atan2(offset @ y_axis, offset @ x_axis)

    logs, sines = [], []
    for j in range(len(points)):
        distance = math.dist(points[i], points[j])
        if j == i or distance == 0.0:
            continue
        height = float(normal @ (points[j] - points[i]))  # y_i(c_j)
        width = max(math.exp(-0.5 * (height / sigma) ** 2), 1e-3)  # eq. 13
        log_height = -0.5 * distance**2 / sigma**2  # log of eq. 12
        above = math.sqrt(max(distance**2 - height**2, 0.0)) < 1e-6 * distance
        phi = 0.0 if above else angle(x) - angle(points[j])
        logs.append(log_height - 0.5 * math.sin(phi / 2.0) ** 2 / width**2)  # log of eq. 11
        sines.append(height / distance)
    if not logs:
        return 0.0
    largest = max(logs)
    kernels = [math.exp(value - largest) for value in logs]
    merged = sum(k * s for k, s in zip(kernels, sines, strict=True)) / sum(kernels)  # eqs. 14, 15
    return min(max(merged, -0.98), 0.98)


def local_implicit_surface(
    x: FloatArray,
    points: FloatArray,
    normals: FloatArray,
    weights: FloatArray,
    sigma: float,
    beta_sign: float,
) -> float:
    """Eq. 7 over sum_i w_i k; beta_sign: +1 as published (eq. 10), -1 corrected, 0 for beta = 1."""
    nearest = min(math.dist(x, p) for p in points)
    numerator = denominator = 0.0
    for i in range(len(points)):
        # A common factor exp(nearest^2 / 2 sigma^2) keeps far points from 0 / 0.
        kernel = math.exp(-0.5 * (math.dist(x, points[i]) ** 2 - nearest**2) / sigma**2)
        height = float(normals[i] @ (x - points[i]))  # eq. 8
        sign = (height > 0) - (height < 0)
        beta = 1.0
        if beta_sign:
            beta += beta_sign * sign * beta_star(x, i, points, normals, sigma)  # eq. 10
        numerator += weights[i] * height * kernel * beta
        denominator += weights[i] * kernel
    return numerator / denominator


def kernel_value(name: str, u: FloatArray, v: FloatArray, length: float) -> float:
    r = math.sqrt(float((u - v) @ (u - v)))
    if name == "rbf":
        return math.exp(-(r**2) / (2 * length**2))
    if name == "matern52":
        q = math.sqrt(5) * r / length
        return (1 + q + q**2 / 3) * math.exp(-q)
    return (2 * r**3 - 3 * length * r**2 + length**3) / length**3


def gaussian_process(
    name: str,
    queries: FloatArray,
    nodes: FloatArray,
    normals: FloatArray,
    *,
    length: float,
    value_noise: float,
    gradient_noise: float,
    mean: float,
    step: float = 1e-4,
) -> tuple[FloatArray, FloatArray]:
    """Posterior mean and variance by dense inversion; derivatives of the kernel by differences.

    A slope is observed as the difference of f at two points `step` to either side: a linear
    functional of f, so that every covariance is a sum of kernel values, and the process is exact
    for these functionals. They differ from slopes by O(step^2).
    """
    functionals: list[list[tuple[float, FloatArray]]] = [[(1.0, node)] for node in nodes]
    targets = [-mean] * len(nodes)
    noises = [value_noise**2] * len(nodes)
    for node, normal in zip(nodes, normals, strict=True):
        for axis in range(3):
            move = step * np.eye(3)[axis]
            functionals.append([(0.5 / step, node + move), (-0.5 / step, node - move)])
            targets.append(normal[axis])
            noises.append(gradient_noise**2)

    def covariance(a: list[tuple[float, FloatArray]], b: list[tuple[float, FloatArray]]) -> float:
        return sum(s * t * kernel_value(name, u, v, length) for s, u in a for t, v in b)

    count = len(functionals)
    matrix = np.empty((count, count))
    for i in range(count):
        for j in range(count):
            matrix[i, j] = covariance(functionals[i], functionals[j])
    inverse = np.linalg.inv(matrix + np.diag(noises))
    means, variances = [], []
    for query in queries:
        cross = np.array([covariance([(1.0, query)], f) for f in functionals])
        means.append(mean + cross @ inverse @ np.array(targets))
        variances.append(kernel_value(name, query, query, length) - cross @ inverse @ cross)
    return np.array(means), np.array(variances)


def winding_number(point: FloatArray, triangles: FloatArray) -> float:
    """Sum of the triangles' solid angles (Van Oosterom and Strackee 1983) over 4 pi."""
    total = 0.0
    for a, b, c in triangles - point:
        la, lb, lc = (float(np.linalg.norm(v)) for v in (a, b, c))
        denominator = la * lb * lc + (a @ b) * lc + (b @ c) * la + (c @ a) * lb
        total += math.atan2(a @ np.cross(b, c), denominator)
    return total / (2.0 * math.pi)


def hoppe_normals(points: FloatArray, neighbours: int = 8) -> FloatArray:
    """Planes of neighbours, signed along a minimum spanning tree (Hoppe et al. 1992, 3.3)."""
    count = len(points)
    distances = np.linalg.norm(points[:, None] - points, axis=2)
    near = np.argsort(distances, axis=1)[:, : neighbours + 1]
    normals = np.array([np.linalg.svd(points[i] - points[i].mean(0))[2][2] for i in near])
    costs = 10.0 + distances / distances.max()  # far points link what neighbours do not
    for i in range(count):
        for j in near[i, 1:]:
            costs[i, j] = costs[j, i] = 1.001 - abs(normals[i] @ normals[j])
    tree = minimum_spanning_tree(costs)
    center = points.mean(axis=0)
    root = int(np.argmax(np.linalg.norm(points - center, axis=1)))
    order, before = breadth_first_order(tree + tree.T, root, directed=False)
    normals[root] *= np.sign(normals[root] @ (points[root] - center)) or 1.0
    for i in order[1:]:
        if normals[i] @ normals[before[i]] < 0.0:
            normals[i] *= -1.0
    return normals
