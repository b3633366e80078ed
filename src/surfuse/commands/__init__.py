"""Every command of surfuse as one call with plain arguments, in rooms by what a user does."""
