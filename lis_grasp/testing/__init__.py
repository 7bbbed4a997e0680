"""Checks of other packages' estimators, policies and hands, alone or as parameters of pytest."""

from lis_grasp.testing.check import Check, HeldClaims
from lis_grasp.testing.estimator_checks import check_estimator, estimator_checks
from lis_grasp.testing.hand_checks import check_hand, hand_checks
from lis_grasp.testing.policy_checks import check_policy, policy_checks

__all__ = [
    "Check",
    "HeldClaims",
    "check_estimator",
    "check_hand",
    "check_policy",
    "estimator_checks",
    "hand_checks",
    "policy_checks",
]
