"""What sensors on a serial line share: framed bytes to readings, and a port that can vanish."""
