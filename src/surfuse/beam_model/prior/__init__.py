"""What is expected of a surface before anything is heard: a raster, piecewise smooth."""
