"""The whole of it: every command of surfuse as one function that is given plain arguments."""

from surfuse.pipeline.acquisition import acquire, resume
from surfuse.pipeline.outcome import Outcome, SilentWatcher, Watcher
from surfuse.pipeline.reporting import report, view
from surfuse.pipeline.scoring import evaluate

__all__ = ["Outcome", "SilentWatcher", "Watcher", "acquire", "evaluate", "report", "resume", "view"]
