"""The search for the surface that explains the readings best."""
