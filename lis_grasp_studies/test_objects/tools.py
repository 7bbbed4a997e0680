"""Test objects that are tools and flat things, as they lie on a table."""

from __future__ import annotations

from lis_grasp_studies.test_objects.solid_modelling import Solid, block, disk, extrude, rod


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
