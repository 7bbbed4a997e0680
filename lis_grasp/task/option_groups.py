"""Titles of groups of options in the help, in their order; others are listed before all."""

TOUCHING, SENSOR, SURFACE = "touching", "tactile sensor", "surface"
GRASPING, ARM = "grasp and lift", "arm"
GROUPS = (TOUCHING, SENSOR, SURFACE, GRASPING, ARM)
