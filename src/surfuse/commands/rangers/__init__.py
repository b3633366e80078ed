"""Rangers by themselves: data sheet and acceptance."""
