"""The vision steps alone, on any picture."""
