"""Robot arms: description files, kinematics, reach, collision-free paths, and their checks."""
