"""The whole of it: every command of surfuse as one function that is given plain arguments; one module a command."""
