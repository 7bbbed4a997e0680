"""Robot hands and arms: description files, kinematics, collision checks and drafts; no Drake."""
