"""First description of a hand, found from its file by geometry, sampling and search."""
