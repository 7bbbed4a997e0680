"""Opposition of a hand's fingers: which finger is the thumb."""

from __future__ import annotations

import numpy as np

from lis_grasp.typing import FloatArray


def thumb_of(axes: FloatArray) -> int:
    """Return the index of the finger that opposes the others.

    Its pad's axis is the least aligned with the mean axis of the other pads.

    Parameters
    ----------
    axes
        Shape (F, 3), unit: the pads' axes, as of `Hand.pad_axes`.
    """
    return int(np.argmin([axes[f] @ np.delete(axes, f, axis=0).mean(0) for f in range(len(axes))]))
