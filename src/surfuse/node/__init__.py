"""The sensor node on the bus."""
