"""Published parameters of arms beyond their kinematics; no plug-ins."""
