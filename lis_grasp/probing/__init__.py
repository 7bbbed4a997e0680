"""Guarded motions of a hand towards an object, and the kinematic prober; no Drake."""
