"""The version of the package, which nothing needs the package itself to read."""

__version__ = "2.0.0"
