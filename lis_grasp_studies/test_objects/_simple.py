"""Prismatic and curved test objects: planes only; bodies of revolution and cylinders, cut."""

from __future__ import annotations

import manifold3d
import numpy as np

from lis_grasp.shapes.builtin import circle
from lis_grasp_studies.test_objects.solid_modelling import (
    Solid,
    ball,
    block,
    curve,
    disk,
    extrude,
    outline,
    revolve,
    rod,
    star,
    superquadric,
    tube,
    turned,
)


def vase() -> Solid:
    """Return a vase with a belly and a neck, solid, 0.2 m high."""
    return turned([(0.03, -0.1), (0.055, -0.03), (0.022, 0.05), (0.035, 0.1)])


def pinched() -> Solid:
    """Return a superquadric of exponent 0.8: cusps and hollow sides, 0.18 m across."""
    return star(superquadric((0.09, 0.07, 0.08), 0.8), segments=160)


def cone() -> Solid:
    """Return a blunt cone, 0.13 m high."""
    return rod(0.055, 0.13, top=0.008)


def capsule() -> Solid:
    """Return a cylinder with round ends, 0.19 m long."""
    ends = [ball(0.028).translate((0.0, 0.0, side * 0.067)) for side in (-1.0, 1.0)]
    return rod(0.028, 0.134) + ends[0] + ends[1]


def lens() -> Solid:
    """Return the intersection of two balls: one sharp round edge, 0.14 m across."""
    return ball(0.09).translate((0.0, 0.0, -0.055)) ^ ball(0.09).translate((0.0, 0.0, 0.055))


def bottle() -> Solid:
    """Return a bottle with a shoulder, a neck and a rim, solid, 0.24 m high."""
    body = turned([(0.034, -0.12), (0.036, -0.1), (0.036, 0.02), (0.013, 0.07), (0.013, 0.12)])
    return body + rod(0.018, 0.014).translate((0.0, 0.0, 0.113))


def hourglass() -> Solid:
    """Return a one-sheet hyperboloid between flat ends, 0.12 m high."""
    z = np.linspace(-0.06, 0.06, 41)
    return turned(np.column_stack([0.018 * np.sqrt(1.0 + (z / 0.022) ** 2), z]))


def cut_ellipse() -> Solid:
    """Return an elliptic cylinder cut by two planes that are not parallel, 0.15 m long."""
    solid = extrude(disk(1.0).scale((0.05, 0.03)), 0.2)
    solid = solid.trim_by_plane((0.4, 0.2, -1.0), -0.05)
    return solid.trim_by_plane((-0.6, 0.3, 1.0), -0.07)


def dome() -> Solid:
    """Return the upper half of an ellipsoid, 0.12 m across and 0.075 m high."""
    whole = ball(1.0).scale((0.06, 0.06, 0.075))
    return whole.trim_by_plane((0.0, 0.0, 1.0), 0.0)


def stepped_shaft() -> Solid:
    """Return a shaft of four diameters, one of them a cone, 0.22 m long."""
    radii = [(0.018, -0.11), (0.018, -0.05), (0.034, -0.05), (0.034, -0.02), (0.024, -0.02)]
    radii += [(0.024, 0.04), (0.012, 0.11)]
    return revolve([(0.0, -0.11), *radii, (0.0, 0.11)])


def quarter_ring() -> Solid:
    """Return a third of a torus with flat ends, 0.17 m across."""
    angles = np.linspace(0.0, np.deg2rad(130.0), 60)
    path = 0.085 * np.column_stack([np.cos(angles), np.sin(angles), 0.0 * angles])
    return tube(path, 0.026)


def goblet() -> Solid:
    """Return a cup on a stem and a foot, hollow, 0.18 m high."""
    outer = [(0.038, -0.09), (0.036, -0.082), (0.009, -0.075), (0.008, -0.01)]
    outer += [tuple(p) for p in curve([(0.009, -0.008), (0.04, 0.03), (0.042, 0.09)], 30)]
    inner = [tuple(p) for p in curve([(0.036, 0.09), (0.034, 0.035), (0.0, 0.005)], 30)]
    return revolve([(0.0, -0.09), *outer, *inner])


def saddle_block() -> Solid:
    """Return a block with a cylindrical groove across its top and a round front, 0.13 m long."""
    groove = rod(0.045, 0.3).rotate((90.0, 0.0, 0.0)).translate((0.02, 0.0, 0.065))
    front = rod(0.13, 0.3).rotate((90.0, 0.0, 0.0)).translate((-0.065, 0.0, 0.0))
    return (block(0.13, 0.07, 0.09) ^ front) - groove


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
