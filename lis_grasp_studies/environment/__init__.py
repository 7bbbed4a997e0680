"""A Gymnasium environment of touch: ``lis_grasp/Touch-v0``, registered by importing this folder."""

from lis_grasp.exceptions import needed_package

with needed_package("Gymnasium", "gym"):
    import gymnasium

ID = "lis_grasp/Touch-v0"
"""For `gymnasium.make` and `gymnasium.make_vec`."""

if ID not in gymnasium.registry:
    gymnasium.register(ID, "lis_grasp_studies.environment.touch_env:TouchEnv")
