"""The second simulator: lifts in MuJoCo, with the phases and the control of those in Drake.

It needs the extra ``mujoco``. Nothing but this folder imports the packages mujoco and coacd.
"""
