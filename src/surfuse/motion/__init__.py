"""Trajectories, limits and clearances."""
