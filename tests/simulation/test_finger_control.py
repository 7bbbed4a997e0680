from types import SimpleNamespace

import numpy as np
import pytest

from lis_grasp.grasping.hand_capacity import balanced_grip
from lis_grasp.lifting.finger_control import FingerControl


def test_fingers_that_can_only_add_to_the_load_still_squeeze():
    # One finger above an object of 2 kg: each push of it adds to the weight.
    points, normals = np.array([[0.0, 0.0, 0.05]]), np.array([[0.0, 0.0, 1.0]])
    weight, center = np.array([0.0, 0.0, -20.0]), np.zeros(3)
    assert not balanced_grip(points, normals, friction=0.5, total=1.0, load=(weight, center)).any()
    control = SimpleNamespace(
        _weight=weight,
        _scene=SimpleNamespace(X_WO=np.eye(4)),
        _p_OC=center,
        _setup=SimpleNamespace(grip_friction=0.5),
    )
    forces = FingerControl._balanced_forces(control, points, normals, 1.0)  # type: ignore[arg-type]
    assert forces == pytest.approx(np.array([[0.0, 0.0, -1.0]]), abs=1e-6)
