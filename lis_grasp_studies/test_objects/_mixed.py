"""Test objects that join planes, curved faces, fillets and handles."""

from __future__ import annotations

import manifold3d
import numpy as np

from lis_grasp.shapes.builtin import at_height, circle
from lis_grasp_studies.test_objects.solid_modelling import (
    Solid,
    ball,
    block,
    curve,
    disk,
    extrude,
    lofted,
    outline,
    revolve,
    rod,
    rounded,
    star,
    superquadric,
    tube,
    turned,
)


def rounded_box() -> Solid:
    """Return a box with fillets of 1 cm at all edges, 0.12 m long."""
    corners = [
        ball(0.01).translate((x, y, z))
        for x in (-0.05, 0.05)
        for y in (-0.03, 0.03)
        for z in (-0.04, 0.04)
    ]
    return Solid.batch_hull(corners)


def screw() -> Solid:
    """Return a screw with a round thread and a hexagonal head, 0.14 m long."""
    z = np.linspace(-0.055, 0.056, 120)
    turn = 2.0 * np.pi * z / 0.022
    centres = np.column_stack([0.003 * np.cos(turn), 0.003 * np.sin(turn), z])
    shaft = lofted([centre + at_height(circle(0.02, 64), 0.0) for centre in centres])
    head = extrude(outline(circle(0.035, 6)), 0.03).translate((0.0, 0.0, 0.07))
    return shaft + head


def socket() -> Solid:
    """Return a round body with a square shaft, 0.13 m long."""
    return rod(0.04, 0.06) + block(0.036, 0.036, 0.09).translate((0.0, 0.0, 0.055))


def mug() -> Solid:
    """Return a mug with a handle, 0.1 m high."""
    cup = rod(0.04, 0.1) - rod(0.035, 0.1).translate((0.0, 0.0, 0.006))
    knots = [
        (0.037, 0, -0.03),
        (0.062, 0, -0.024),
        (0.07, 0, 0.002),
        (0.06, 0, 0.026),
        (0.037, 0, 0.03),
    ]
    handle = tube(curve(knots, 50), 0.0065, sides=32)
    return cup + (handle - rod(0.0375, 0.2))


def hammer() -> Solid:
    """Return a hammer: a head with a round face and a wedge, an oval handle, 0.25 m long."""
    face = rod(0.016, 0.045).rotate((0.0, 90.0, 0.0)).translate((0.035, 0.0, 0.0))
    corners = [(-0.06, -0.003), (-0.015, -0.016), (0.015, -0.016), (0.015, 0.016), (-0.015, 0.016)]
    wedge = extrude(outline([*corners, (-0.06, 0.003)]), 0.032)
    handle = extrude(disk(1.0).scale((0.015, 0.011)), 0.23).translate((0.0, 0.0, -0.115))
    return face + wedge.rotate((90.0, 0.0, 0.0)) + handle


def pipe_tee() -> Solid:
    """Return a pipe with an open branch, 0.16 m long."""
    run, branch = rod(0.03, 0.16), rod(0.024, 0.08).rotate((0.0, 90.0, 0.0))
    outer = run + branch.translate((0.04, 0.0, 0.0))
    bore = rod(0.022, 0.2) + rod(0.016, 0.1).rotate((0.0, 90.0, 0.0)).translate((0.05, 0.0, 0.0))
    return outer - bore


def fluted_knob() -> Solid:
    """Return a knob with seven flutes, a conical side and a round top, 0.08 m across."""
    flutes = manifold3d.CrossSection.batch_boolean(
        [disk(0.009).translate(tuple(p)) for p in circle(0.042, 7)], manifold3d.OpType.Add
    )
    body = extrude(disk(0.04) - flutes, 0.04, top=0.85)
    return (body ^ ball(0.07).translate((0.0, 0.0, -0.049))) + rod(0.02, 0.03).translate(
        (0, 0, -0.03)
    )


def kettlebell() -> Solid:
    """Return a ball with a flat foot and a bow handle, 0.17 m high."""
    body = ball(0.05).trim_by_plane((0.0, 0.0, 1.0), -0.04)
    knots = [(-0.03, 0, 0.03), (-0.042, 0, 0.08), (0, 0, 0.108), (0.042, 0, 0.08), (0.03, 0, 0.03)]
    return body + tube(curve(knots, 60), 0.0105)


def screwdriver() -> Solid:
    """Return a screwdriver: a fluted handle, a shaft and a flat tip, 0.22 m long."""
    handle = turned([(0.011, -0.1), (0.017, -0.085), (0.015, -0.03), (0.017, 0.0), (0.009, 0.012)])
    grooves = [rod(0.005, 0.2).translate((0.0185 * x, 0.0185 * y, 0.0)) for x, y in circle(1.0, 6)]
    shaft = rod(0.006, 0.11).translate((0.0, 0.0, 0.06))
    tip = block(0.011, 0.004, 0.02).translate((0.0, 0.0, 0.115))
    return handle - Solid.batch_boolean(grooves, manifold3d.OpType.Add) + shaft + tip


def drilled_block() -> Solid:
    """Return a block with a hole through it, a boss and a slot, 0.14 m long."""
    hole = rod(0.016, 0.2).translate((-0.04, 0.0, 0.0))
    boss = rod(0.022, 0.03).translate((0.035, 0.0, 0.045))
    slot = block(0.02, 0.2, 0.03).translate((0.0, 0.0, 0.03))
    return block(0.14, 0.075, 0.06) + boss - hole - slot


def filleted_angle() -> Solid:
    """Return an angle with rounded inner and outer corners in its section, 0.1 m long."""
    corners = [(0, 0), (0.09, 0), (0.09, 0.04), (0.045, 0.04), (0.045, 0.1), (0, 0.1)]
    return extrude(rounded(outline(corners), 0.012), 0.1)


def camera() -> Solid:
    """Return a camera: a body with rounded vertical edges, a lens and a button, 0.13 m wide."""
    plan = rounded(manifold3d.CrossSection.square((0.13, 0.045), True), 0.014)
    lens = rod(0.03, 0.05, top=0.026).rotate((90.0, 0.0, 0.0)).translate((0.015, -0.04, 0.0))
    return extrude(plan, 0.08) + lens + rod(0.009, 0.014).translate((-0.045, 0.0, 0.045))


def pillow_plate() -> Solid:
    """Return a soft cushion on a square plinth with a chamfered edge, 0.13 m wide."""
    levels = ((1.0, -0.015), (1.0, 0.015), (0.8, 0.027))
    signs = ((-1.0, -1.0), (-1.0, 1.0), (1.0, -1.0), (1.0, 1.0))
    corners = [(a * s * 0.065, b * s * 0.05, z) for s, z in levels for a, b in signs]
    cushion = star(superquadric((0.052, 0.04, 0.03), 2.6)).translate((0.0, 0.0, 0.027))
    return Solid.hull_points(corners) + cushion


def pulley() -> Solid:
    """Return a wheel with a V groove, a bore and a hub, 0.15 m across."""
    rim = [(0.03, -0.012), (0.075, -0.018), (0.075, -0.012), (0.058, 0.0), (0.075, 0.012)]
    hub = [(0.075, 0.018), (0.03, 0.012), (0.03, 0.032), (0.014, 0.032), (0.014, -0.024)]
    return revolve([*hub, (0.03, -0.024), *rim])
