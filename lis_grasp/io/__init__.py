"""File formats of contacts and surfaces, atomic writing, and provenance headers."""
