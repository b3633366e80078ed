"""The scan plan: margin around the outline, raster of stops, and which of them the arm can reach safely."""
