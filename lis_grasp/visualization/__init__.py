"""Scene pages of contacts, estimates, grasps and lifts, for a browser or a notebook."""

from lis_grasp.visualization.colours import ColourScale
from lis_grasp.visualization.scene import Scene
from lis_grasp.visualization.scene_server import SceneServer, serve_scene

__all__ = ["ColourScale", "Scene", "SceneServer", "serve_scene"]
__dir__ = sorted(__all__).copy  # dir() lists the public names
