"""The task, split as the world is: World, Robot, Known and Decide, in a scene file too."""

from lis_grasp.task.decide import Decide
from lis_grasp.task.known import Known
from lis_grasp.task.robot import Robot
from lis_grasp.task.scene_file import load_scene, write_scene
from lis_grasp.task.task import Task
from lis_grasp.task.world import World

__all__ = ["Decide", "Known", "Robot", "Task", "World", "load_scene", "write_scene"]
