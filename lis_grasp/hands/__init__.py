"""Robot hands: description files (YAML, URDF, SDF), kinematics, collision, and checks; no Drake."""
