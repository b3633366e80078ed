"""Sensors that measure where their axis ends: zones of light, spots, contact; and how they go with sound."""
