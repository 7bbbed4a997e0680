"""Bodies beside the object: bins, shelves, walls, neighbours; fixed or free."""

from lis_grasp.world.known_bodies import KnownBodies
from lis_grasp.world.surroundings import ALONE, Body, Surroundings

__all__ = ["ALONE", "Body", "KnownBodies", "Surroundings"]
