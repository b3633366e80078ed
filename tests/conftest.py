"""Settings that all tests share."""

from hypothesis import settings

# The same examples on every machine and every day: a red test is a change of the code, never of the dice.
settings.register_profile("repeatable", derandomize=True, deadline=None)
settings.load_profile("repeatable")
