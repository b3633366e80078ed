"""The parts of the beam-aware method: echo physics, stations, arrivals, smoothing, edges, guard, uncertainty."""
