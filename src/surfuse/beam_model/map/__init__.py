"""From readings to the finished map, whole, in tiles, or live."""
