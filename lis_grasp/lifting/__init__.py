"""The lift trial without a simulator: its settings, its outcome, and the wrist's trajectory."""
