"""What a hand carries, against bodies and table."""

import numpy as np

from lis_grasp import Hand, shapes
from lis_grasp.geometry import make_pose
from lis_grasp.grasping.body_clearance import BodyClearance
from lis_grasp.world import Body, Surroundings


def test_an_estimate_below_its_table_is_not_carried_into_it() -> None:
    """It is by the estimate's error; a turn that lowers it further still hits the table."""
    hand, mesh = Hand.load("wsg50"), shapes.find("box").mesh
    far = Surroundings((Body.box("far", (0.1, 0.1, 0.1), (2.0, 0.0, 0.0)),))
    lowest = float(mesh.bounds[0, 2])
    X_OH = make_pose(np.diag([1.0, -1.0, -1.0]), [0.0, 0.0, 0.2])
    up = X_OH.copy()
    up[2, 3] += 0.001
    down = X_OH.copy()
    down[2, 3] -= 0.001
    for table in (lowest, lowest + 0.01):
        clearance = BodyClearance(hand, mesh, far, support_height=table)
        assert clearance.hit_by_object(X_OH, up[None]) is None
        assert clearance.hit_by_object(X_OH, down[None]) == "table"
