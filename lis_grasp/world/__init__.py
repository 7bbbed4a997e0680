"""Bodies beside the object: bins, shelves, walls, neighbours; fixed or free."""

from lis_grasp.world.known_bodies import KnownBodies
from lis_grasp.world.surroundings import ALONE, Body, Surroundings
from lis_grasp.world.table import Table

__all__ = ["ALONE", "Body", "KnownBodies", "Surroundings", "Table"]
