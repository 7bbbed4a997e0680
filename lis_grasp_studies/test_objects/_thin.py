"""Test objects of plates, sheets, rods and rings, 3 to 14 mm thick, and of tools."""

from __future__ import annotations

import manifold3d
import numpy as np

from lis_grasp.typing import FloatArray
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


def plate() -> Solid:
    """Return a flat plate of 0.15 by 0.1 m, 8 mm thick."""
    return block(0.15, 0.1, 0.008)


def hook() -> Solid:
    """Return a round rod of 13 mm bent to a hook, 0.15 m long."""
    knots = [(0, 0, -0.07), (0, 0, -0.02), (0, 0, 0.02), (0.012, 0, 0.05), (0.04, 0, 0.06)]
    path = curve([*knots, (0.065, 0, 0.045), (0.07, 0, 0.02)], 80)
    return tube(path, 0.0065, sides=32)


def dish() -> Solid:
    """Return a shallow dish of 5 mm, 0.18 m across."""
    return _shell(0.12, 0.005, -0.08)


def spoon() -> Solid:
    """Return a spoon with a hollow oval bowl and a flat, bent handle, 0.2 m long."""
    outer, inner = ball(1.0).scale((0.034, 0.023, 0.016)), ball(1.0).scale((0.031, 0.02, 0.0125))
    bowl = (outer - inner).trim_by_plane((0.0, 0.0, -1.0), 0.0)
    path = curve([(0.031, 0, -0.003), (0.06, 0, 0.004), (0.11, 0, 0.012), (0.17, 0, 0.01)], 50)
    return bowl + tube(path, np.linspace(0.005, 0.009, 50), sides=32, flatness=2.2).scale(
        (1, 0.8, 0.5)
    )


def angle_sheet() -> Solid:
    """Return a sheet of 4 mm bent to an obtuse angle with a fold, 0.13 m wide."""
    middle = np.array([(-0.08, 0.045), (-0.02, 0.0), (0.05, 0.0), (0.06, 0.025)])
    return extrude(_strip(middle, 0.004), 0.13)


def bowl() -> Solid:
    """Return a deep bowl of 6 mm, 0.14 m across."""
    return _shell(0.074, 0.006, 0.0)


def wrench() -> Solid:
    """Return an open wrench with a ring at its other end, 9 mm thick, 0.2 m long."""
    head = disk(0.024) - outline([(-0.03, -0.009), (0.008, -0.009), (0.008, 0.009), (-0.03, 0.009)])
    ring = (disk(0.018) - disk(0.011, segments=6)).translate((0.16, 0.0))
    grip = outline([(0.016, -0.009), (0.147, -0.007), (0.147, 0.007), (0.016, 0.009)])
    return extrude(head + grip + ring, 0.009)


def bangle() -> Solid:
    """Return a ring with an oval section of 7 by 14 mm, 0.08 m across."""
    angles = np.linspace(0.0, 2.0 * np.pi, 48, endpoint=False)
    section = np.column_stack([0.036 + 0.0035 * np.cos(angles), 0.007 * np.sin(angles)])
    return revolve(section)


def s_rod() -> Solid:
    """Return an oval rod of 10 by 15 mm bent in space, 0.2 m long."""
    knots = [(-0.09, 0, 0), (-0.05, 0.03, 0), (0, 0, 0.02), (0.045, -0.035, 0.03), (0.09, 0, 0.05)]
    return tube(curve(knots, 90), 0.0075, sides=32, flatness=0.7)


def comb() -> Solid:
    """Return a comb with six teeth, 6 mm thick, 0.16 m long."""
    spine = outline([(-0.08, 0.0), (0.08, 0.0), (0.08, 0.025), (-0.08, 0.025)])
    teeth = [
        outline([(x - 0.006, -0.05), (x + 0.006, -0.05), (x + 0.006, 0.01), (x - 0.006, 0.01)])
        for x in np.linspace(-0.074, 0.074, 6)
    ]
    return extrude(
        manifold3d.CrossSection.batch_boolean([spine, *teeth], manifold3d.OpType.Add), 0.006
    )


def spatula() -> Solid:
    """Return a spatula: a rounded blade of 3 mm at an angle to a round handle, 0.24 m long."""
    plan = rounded(manifold3d.CrossSection.square((0.08, 0.06), True), 0.012)
    blade = extrude(plan, 0.003).rotate((0.0, 18.0, 0.0)).translate((0.1, 0.0, -0.012))
    handle = rod(0.007, 0.19).rotate((0.0, 90.0, 0.0)).translate((-0.025, 0.0, 0.0))
    return blade + handle


def _shell(radius: float, wall: float, floor: float) -> Solid:
    """Return the part of a spherical shell below z = floor, shifted to the origin."""
    shell = ball(radius) - ball(radius - wall)
    return shell.trim_by_plane((0.0, 0.0, -1.0), -floor).translate((0.0, 0.0, -floor))


def _strip(middle: FloatArray, wall: float) -> manifold3d.CrossSection:
    """Return the outline of a strip about an open polyline (n, 2), with mitred corners."""
    steps = np.diff(middle, axis=0)
    steps /= np.linalg.norm(steps, axis=1, keepdims=True)
    sides = np.column_stack([-steps[:, 1], steps[:, 0]])
    mitres = np.vstack([sides[:1], sides[:-1] + sides[1:], sides[-1:]])
    mitres[1:-1] /= (1.0 + np.einsum("nk,nk->n", sides[:-1], sides[1:]))[:, None]
    return outline(np.vstack([middle - 0.5 * wall * mitres, (middle + 0.5 * wall * mitres)[::-1]]))


def clamp() -> Solid:
    """Return a bar clamp: a bar with a fixed and a sliding jaw and a spindle, 0.18 m long."""
    bar = block(0.18, 0.02, 0.012)
    jaws = [block(0.022, 0.08, 0.016).translate((x, 0.035, 0.0)) for x in (-0.079, 0.03)]
    spindle = rod(0.006, 0.07).rotate((0.0, 90.0, 0.0)).translate((0.06, 0.06, 0.0))
    grip = rod(0.011, 0.03).rotate((0.0, 90.0, 0.0)).translate((0.1, 0.06, 0.0))
    return bar + jaws[0] + jaws[1] + spindle + grip


def ruler() -> Solid:
    """Return a ruler of 0.2 by 0.03 m, 4 mm thick."""
    return block(0.2, 0.03, 0.004)


def key() -> Solid:
    """Return a large key: a round bow with a hole, a shaft and two teeth, 0.09 m long."""
    bow = extrude(disk(0.016) - disk(0.006), 0.006)
    shaft = block(0.065, 0.008, 0.006).translate((0.045, 0.0, 0.0))
    teeth = [block(0.007, 0.012, 0.006).translate((x, -0.008, 0.0)) for x in (0.058, 0.072)]
    return bow + shaft + teeth[0] + teeth[1]


def pen() -> Solid:
    """Return a pen with a cap's clip, 0.14 m long and 11 mm thick."""
    body = rod(0.0055, 0.13) + rod(0.0055, 0.01, top=0.0015).translate((0.0, 0.0, 0.07))
    clip = block(0.004, 0.003, 0.035).translate((0.0065, 0.0, -0.04))
    return (body + clip).rotate((0.0, 90.0, 0.0))


def chisel() -> Solid:
    """Return a round handle with a flat blade, 0.21 m long."""
    handle = turned([(0.012, 0.0), (0.016, 0.03), (0.014, 0.08), (0.011, 0.1)])
    return handle + block(0.014, 0.004, 0.12).translate((0.0, 0.0, 0.15))


def paddle() -> Solid:
    """Return a flat round paddle with a handle, 10 mm thick, 0.23 m long."""
    grip = outline([(0.05, -0.011), (0.17, -0.011), (0.17, 0.011), (0.05, 0.011)])
    return extrude(rounded(disk(0.06) + grip, 0.005), 0.01)


def angle_bar() -> Solid:
    """Return a bar with an L-shaped section of 30 by 40 mm, walls of 6 mm, 0.2 m long."""
    section = [(0, 0), (0.03, 0), (0.03, 0.006), (0.006, 0.006), (0.006, 0.04), (0, 0.04)]
    return extrude(outline(section), 0.2)


def tongs() -> Solid:
    """Return two flat arms that open from a bow, 12 mm wide, 0.2 m long."""
    arms = [
        outline([(0.0, y), (0.19, 3.0 * y), (0.19, 3.0 * y + 0.004), (0.0, y + 0.004)])
        for y in (0.008, -0.012)
    ]
    return extrude(arms[0] + arms[1] + (disk(0.016) - disk(0.011)), 0.012)


def tapered_peg() -> Solid:
    """Return a cone that tapers from 34 to 12 mm, 0.18 m long."""
    return rod(0.017, 0.18, top=0.006)


def rasp() -> Solid:
    """Return a half-round bar of 26 by 10 mm with a narrow tang, 0.22 m long."""
    half = disk(0.013) ^ outline([(-0.02, 0.0), (0.02, 0.0), (0.02, 0.01), (-0.02, 0.01)])
    return extrude(half, 0.16) + block(0.008, 0.006, 0.07).translate((0.0, 0.004, 0.105))


def rolling_pin() -> Solid:
    """Return a thick roller with two thin handles, 0.24 m long."""
    handles = rod(0.009, 0.24)
    return handles + rod(0.021, 0.14).translate((0.0, 0.0, 0.05))


def hex_key() -> Solid:
    """Return a rod of 9 mm bent to an L, 0.18 m long."""
    path = curve([(0, 0, 0), (0.06, 0, 0), (0.15, 0, 0), (0.165, 0.015, 0), (0.165, 0.05, 0)], 60)
    return tube(path, 0.0045, sides=6)
