"""What several map formats share: triangles of the measured cells, regular grids, native NetCDF layout."""
