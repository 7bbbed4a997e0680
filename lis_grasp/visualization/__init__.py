"""Scenes of contacts, estimates, grasps and lifts: a page that opens anywhere, or in a notebook."""

from lis_grasp.visualization.scene import Scene, show, write_scene
from lis_grasp.visualization.scene_server import SceneServer, serve_scene

__all__ = ["Scene", "SceneServer", "serve_scene", "show", "write_scene"]
