"""Echoes of the twin: from surfaces over arrivals and the received envelope to the kit's reading."""
