"""Test objects of five families: development and evaluation shapes, disjoint."""
