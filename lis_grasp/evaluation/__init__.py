"""Evaluation against the truth: errors of surfaces, and what planned grasps are worth on it."""
