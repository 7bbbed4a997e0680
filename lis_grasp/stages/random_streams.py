"""Streams of random numbers: a stage that runs alone repeats its part of a whole run."""

from __future__ import annotations

from enum import IntEnum

import numpy as np


class Stream(IntEnum):
    """Purposes of random numbers; each draws from its own stream."""

    TOUCH = 1
    GRASP = 2
    PLACE = 3
    BODIES = 4
    PLACING = 5
    VIEW = 6

    def rng(self, seed: int) -> np.random.Generator:
        """Return the generator of the stream for a seed."""
        return np.random.default_rng([seed, int(self)])
