"""From picture to outline: threshold, boundary, dominant points, pixels to metres."""
