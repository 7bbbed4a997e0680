"""Simulation in Drake, at both ends of the flow: touching an object, and lifting it."""
