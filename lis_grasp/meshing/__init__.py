"""Meshing of implicit surfaces: closed, outward, with sharp edges."""

from lis_grasp.meshing.extraction import extract_mesh

__all__ = ["extract_mesh"]
