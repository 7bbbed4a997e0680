"""Files of results: the only folder that knows their names."""
