"""The touch benchmark: a frozen protocol, its tracks, and rows of what was measured by it."""
