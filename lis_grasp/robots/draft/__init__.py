"""First description of a hand, found from its URDF or SDF by geometry, sampling and search."""
