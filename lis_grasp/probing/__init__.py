"""Approach planning, guarded motion and the kinematic prober; no Drake."""
