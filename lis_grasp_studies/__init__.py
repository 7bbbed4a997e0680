"""Experiments over many trials: the paper's, the study of grasp success, baselines, figures."""
