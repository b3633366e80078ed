"""Pure geometry: poses, polygons, serial chains. Knows nothing of sensors or files."""
