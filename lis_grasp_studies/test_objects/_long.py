"""Long objects: those that exploration of the extent is reported on."""

from __future__ import annotations

from lis_grasp_studies.test_objects.solid_modelling import (
    Solid,
    block,
    curve,
    disk,
    extrude,
    outline,
    rod,
    rounded,
    tube,
    turned,
)


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
