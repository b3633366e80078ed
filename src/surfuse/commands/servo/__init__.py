"""The servo study."""
