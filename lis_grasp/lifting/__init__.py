"""Lift of an object: setup, options, outcome and wrist trajectory; no Drake."""
