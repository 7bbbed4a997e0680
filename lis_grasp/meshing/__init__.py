"""From an implicit surface to a closed, outward-oriented mesh that keeps sharp edges."""

from lis_grasp.meshing.extraction import extract_mesh

__all__ = ["extract_mesh"]
