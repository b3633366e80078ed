"""Looking on while something runs."""
