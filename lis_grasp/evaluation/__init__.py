"""Evaluation against the truth: surface errors, grasp quality, calibration."""
