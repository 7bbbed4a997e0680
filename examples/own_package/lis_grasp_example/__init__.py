"""An estimator, a policy and a hand for lis-grasp, found by name once this package is installed."""

from pathlib import Path

square_jaw = Path(__file__).with_name("square_jaw.yaml")
"""The description of a parallel-jaw gripper."""
