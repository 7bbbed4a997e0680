"""Touch, estimate, exploration and grasp as systems in the user's own Drake Diagram."""

from lis_grasp._moved import module_names
from lis_grasp.drake.bodies import add_hand, add_object
from lis_grasp.drake.depth_viewer import DepthViewer
from lis_grasp.drake.grasp_planner import GraspPlanner
from lis_grasp.drake.haptic_explorer import HapticExplorer
from lis_grasp.drake.surface_estimator import SurfaceEstimator
from lis_grasp.simulation.drake.touch_sensor import TouchSensor
from lis_grasp.simulation.drake.world_bodies import surroundings_of

__all__ = [
    "DepthViewer",
    "GraspPlanner",
    "HapticExplorer",
    "SurfaceEstimator",
    "TouchSensor",
    "add_hand",
    "add_object",
    "surroundings_of",
]
__getattr__, __dir__ = module_names(__name__, __all__)
