"""Fusing recorded readings."""
