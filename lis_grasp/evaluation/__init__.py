"""Evaluation against the truth: surface errors, grasp quality."""

from lis_grasp.evaluation.grasp_on_truth import epsilon_on_truth
from lis_grasp.evaluation.surface_error import SurfaceError, surface_error
from lis_grasp.shapes.mesh_distance import distances_to_mesh

__all__ = ["SurfaceError", "distances_to_mesh", "epsilon_on_truth", "surface_error"]
