"""Evaluation: every published number of a version, from one configuration file."""
