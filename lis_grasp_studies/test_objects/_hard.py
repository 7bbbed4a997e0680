"""Objects that are hard to hold: flat, thin, long, or heavy at one end."""

from __future__ import annotations

import manifold3d
import numpy as np

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
    rounded,
    tube,
    turned,
)


def washer() -> Solid:
    """Return a flat ring, 70 mm across, 4 mm thick, with a hole of 30 mm."""
    return extrude(disk(0.035) - disk(0.015), 0.004)


def coaster() -> Solid:
    """Return a rounded square plate of 95 mm, 5 mm thick."""
    return extrude(rounded(manifold3d.CrossSection.square((0.095, 0.095), True), 0.012), 0.005)


def scissors() -> Solid:
    """Return closed scissors, 0.17 m long, 6 mm thick, with two rings."""
    blades = outline([(-0.01, -0.009), (0.11, -0.001), (0.11, 0.001), (-0.01, 0.009)])
    plane = blades + outline([(-0.03, -0.012), (0.0, -0.008), (0.0, 0.008), (-0.03, 0.012)])
    for y in (-0.019, 0.019):
        plane += (disk(0.017) - disk(0.011)).translate((-0.043, y))
    return extrude(plane, 0.006)


def table_knife() -> Solid:
    """Return a table knife, 0.22 m long: a blade of 2.5 mm and an oval handle of 9 mm."""
    blade = outline([(0.0, -0.008), (0.1, -0.011), (0.12, 0.0), (0.115, 0.007), (0.0, 0.007)])
    handle = tube(curve([(-0.1, 0, 0), (0.005, 0, 0)], 30), 0.008, flatness=0.56)
    return extrude(rounded(blade, 0.002), 0.0025) + handle.rotate((90.0, 0.0, 0.0))


def fork() -> Solid:
    """Return a table fork, 0.19 m long, bent, 4 mm thick, with four tines."""
    plane = outline([(-0.11, -0.01), (0.0, -0.004), (0.03, -0.012), (0.03, 0.012), (0.0, 0.004)])
    plane += outline([(0.0, -0.004), (0.0, 0.004), (-0.11, 0.01), (-0.11, -0.01)])
    for y in (-0.0105, -0.0035, 0.0035, 0.0105):
        tine = [(0.028, -0.0015), (0.08, -0.001), (0.08, 0.001), (0.028, 0.0015)]
        plane += outline(tine).translate((0.0, y))

    def bent(points: np.ndarray) -> np.ndarray:
        x = points[:, 0]
        return points + np.column_stack([0.0 * x, 0.0 * x, 0.008 * np.sin(x / 0.08 * np.pi)])

    return extrude(plane, 0.004).refine_to_length(0.004).warp_batch(bent)


def saucer() -> Solid:
    """Return a saucer, 0.14 m across, 20 mm high, with a wall of 4 mm."""
    under = [(0.0, 0.0), (0.032, 0.0), (0.036, 0.004), (0.07, 0.016), (0.07, 0.02)]
    upper = [(0.066, 0.02), (0.034, 0.008), (0.0, 0.006)]
    return revolve([*under, *upper])


def perforated_strip() -> Solid:
    """Return a flat strip of 0.16 by 0.022 m, 5 mm thick, with seven holes."""
    plane = rounded(manifold3d.CrossSection.square((0.16, 0.022), True), 0.01)
    for x in np.linspace(-0.066, 0.066, 7):
        plane -= disk(0.005).translate((x, 0.0))
    return extrude(plane, 0.005)


def frying_pan() -> Solid:
    """Return a small pan, 0.13 m across, 28 mm high, with a rising handle."""
    outside = [(0.0, 0.0), (0.05, 0.0), (0.065, 0.028)]
    inside = [(0.062, 0.028), (0.0475, 0.004), (0.0, 0.004)]
    path = curve([(0.06, 0, 0.022), (0.1, 0, 0.03), (0.17, 0, 0.036)], 40)
    return revolve([*outside, *inside]) + tube(path, 0.008, flatness=0.7)


def hatchet() -> Solid:
    """Return a hatchet: an oval handle, 0.24 m long, with a wedge-shaped head at its end."""
    half = [(-0.03, -0.011), (0.02, -0.011), (0.065, -0.001)]
    wedge = outline([*half, *((x, -y) for x, y in reversed(half))])
    handle = tube(curve([(0, 0, -0.12), (0, 0, 0.125)], 30), 0.014, flatness=0.65)
    head = extrude(wedge, 0.05).translate((0.0, 0.0, 0.1))
    return handle.rotate((0.0, 0.0, 90.0)) + head


def jar_lid() -> Solid:
    """Return a lid, 74 mm across, 14 mm high, with a wall of 2.5 mm."""
    inside = rod(0.0345, 0.0115).translate((0.0, 0.0, -0.00125))
    return rod(0.037, 0.014) - inside


def trowel() -> Solid:
    """Return a trowel, 0.22 m long: a triangular blade of 3 mm, a bent neck and a handle."""
    blade = outline([(0.0, -0.035), (0.11, 0.0), (0.0, 0.035)])
    neck = tube(curve([(0.015, 0, 0), (0.0, 0, 0.012), (-0.025, 0, 0.022)], 40), 0.004)
    handle = turned([(0.009, 0.0), (0.012, 0.03), (0.01, 0.08)]).rotate((0.0, -90.0, 0.0))
    return extrude(rounded(blade, 0.004), 0.003) + neck + handle.translate((-0.02, 0.0, 0.022))


def ladle() -> Solid:
    """Return a ladle: a hemispherical cup, 70 mm across, on a flat handle 0.2 m long."""
    cup = (ball(0.035) - ball(0.031)).trim_by_plane((0.0, 0.0, -1.0), 0.0)
    handle = block(0.2, 0.016, 0.005).rotate((0.0, -12.0, 0.0))
    return cup + handle.translate((0.131, 0.0, 0.0195))
