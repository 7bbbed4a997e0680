"""Test objects with plane faces only."""

from __future__ import annotations

import manifold3d
import numpy as np

from lis_grasp.shapes.tessellation import circle
from lis_grasp_studies.test_objects.solid_modelling import Solid, block, extrude, outline


def l_bracket() -> Solid:
    """Return an angle of two thick legs, 0.12 m long."""
    corners = [(0, 0), (0.11, 0), (0.11, 0.035), (0.035, 0.035), (0.035, 0.09), (0, 0.09)]
    return extrude(outline(corners), 0.12)


def stairs() -> Solid:
    """Return a block with two steps, 0.15 m long."""
    corners = [(0, 0), (0.15, 0), (0.15, 0.03), (0.1, 0.03), (0.1, 0.06), (0.05, 0.06)]
    return extrude(outline([*corners, (0.05, 0.09), (0, 0.09)]), 0.08)


def roof() -> Solid:
    """Return a triangular prism like a ramp, 0.16 m long."""
    return extrude(outline([(0, 0), (0.16, 0), (0.03, 0.08)]), 0.09)


def truncated_pyramid() -> Solid:
    """Return a frustum of a square pyramid, 0.11 m high."""
    side = 0.07
    return extrude(
        outline([(-side, -side), (side, -side), (side, side), (-side, side)]), 0.11, top=0.45
    )


def dodecahedron() -> Solid:
    """Return a regular dodecahedron, 0.1 m across."""
    golden = (1.0 + np.sqrt(5.0)) / 2.0
    signs = np.array([(a, b) for a in (-1.0, 1.0) for b in (-1.0, 1.0)])
    flat = np.column_stack([np.zeros(4), signs[:, 0] / golden, signs[:, 1] * golden])
    corners = [np.array([(a, b, c) for a, b in signs for c in (-1.0, 1.0)])]
    corners += [np.roll(flat, shift, axis=1) for shift in range(3)]
    return Solid.hull_points(0.05 / np.sqrt(3.0) * np.vstack(corners))


def t_profile() -> Solid:
    """Return a piece of T beam, 0.2 m long."""
    half, web = 0.05, 0.011
    corners = [(-half, 0.06), (-half, 0.035), (-web, 0.035), (-web, -0.05), (web, -0.05)]
    return extrude(outline([*corners, (web, 0.035), (half, 0.035), (half, 0.06)]), 0.2)


def u_channel() -> Solid:
    """Return a channel with unequal flanges, 0.14 m long."""
    corners = [(0, 0), (0.09, 0), (0.09, 0.075), (0.068, 0.075), (0.068, 0.02), (0.022, 0.02)]
    return extrude(outline([*corners, (0.022, 0.05), (0, 0.05)]), 0.14)


def star_prism() -> Solid:
    """Return a prism on a five-pointed star, 0.05 m high."""
    corners = np.empty((10, 2))
    corners[0::2] = circle(0.075, 5)
    corners[1::2] = circle(0.038, 5, start=np.pi / 5.0)
    return extrude(outline(corners), 0.05)


def faceted_rock() -> Solid:
    """Return the convex hull of 18 random points on an ellipsoid, 0.15 m across."""
    points = np.random.default_rng(5).normal(size=(18, 3))
    points /= np.linalg.norm(points, axis=1, keepdims=True)
    return Solid.hull_points(points * [0.075, 0.06, 0.05])


def gear() -> Solid:
    """Return a spur gear with eight trapezoidal teeth and a square hole, 0.13 m across."""
    teeth, corners = 8, []
    for tooth in range(teeth):
        middle = 2.0 * np.pi * tooth / teeth
        for angle, radius in ((-0.3, 0.047), (-0.16, 0.065), (0.16, 0.065), (0.3, 0.047)):
            corners.append((radius * np.cos(middle + angle), radius * np.sin(middle + angle)))
    hole = manifold3d.CrossSection.square((0.036, 0.036), True)
    return extrude(outline(corners) - hole, 0.035)


def corner_cube() -> Solid:
    """Return a cube of 0.08 m that lacks a smaller cube at one corner and is cut at another."""
    cube = block(0.08, 0.08, 0.08) - block(0.05, 0.05, 0.05).translate((0.04, 0.04, 0.04))
    return cube.trim_by_plane((1.0, 1.0, 1.0), -0.08 / np.sqrt(3.0))
