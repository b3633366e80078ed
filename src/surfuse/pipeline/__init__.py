"""The whole of it: every command of surfuse as one function that is given plain arguments."""

from surfuse.pipeline.outcome import Outcome, SilentWatcher, Watcher

__all__ = ["Outcome", "SilentWatcher", "Watcher"]
