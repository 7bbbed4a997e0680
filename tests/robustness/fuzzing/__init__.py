"""Hostile input, made by rule and seed, and what the package makes of it."""
