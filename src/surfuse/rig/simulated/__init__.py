"""The simulated rig: the only door to the twin."""
