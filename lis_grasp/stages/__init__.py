"""Stages of the pipeline, without files: touch, estimate, plan, lift, place and regrasp."""
