"""Margin, raster, reachability."""
