"""Gridding, splines, comparison with truth, surface parameters."""
