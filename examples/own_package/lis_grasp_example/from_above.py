"""Policy: random touches from above."""

from lis_grasp.exploration import Probe


class FromAbove:
    """Touches the object from above at random places."""

    def __init__(self, space):
        self._space = space

    def next_probe(self, contacts, surface, *, outcomes, rng):
        """Return a probe from half the object's size above it, down to its lowest place."""
        half = 0.5 * self._space.size
        target = self._space.center.copy()
        target[:2] += rng.uniform(-0.6 * half, 0.6 * half, size=2)
        return Probe(target, direction=[0.0, 0.0, -1.0], standoff=2.0 * half, overshoot=half)
