"""Verbs of the command line, which the core finds by their entry points."""
