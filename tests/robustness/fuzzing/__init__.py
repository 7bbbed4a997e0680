"""Fuzzing: generators of malformed input from seeds, and checks of the results."""
