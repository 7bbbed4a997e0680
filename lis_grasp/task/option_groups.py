"""Titles of groups of options in the help, in their order; others are listed before all."""

TOUCHING, SENSOR, CAMERA = "touching", "tactile sensor", "camera"
SURFACE, GRASPING, ARM = "surface", "grasp and lift", "arm"
GROUPS = (TOUCHING, SENSOR, CAMERA, SURFACE, GRASPING, ARM)
