"""The study of objects of which nothing is known: its parts, its lifts in both simulators."""
