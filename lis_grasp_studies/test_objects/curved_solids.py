"""Test objects bounded by bodies of revolution, cylinders and their plane cuts."""

from __future__ import annotations

import numpy as np

from lis_grasp_studies.test_objects.solid_modelling import (
    Solid,
    ball,
    block,
    curve,
    disk,
    extrude,
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
