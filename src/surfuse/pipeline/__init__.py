"""The whole of it: every command of surfuse as one function that is given plain arguments."""

from surfuse.pipeline.acquisition import acquire, resume
from surfuse.pipeline.conversion import export
from surfuse.pipeline.doctor import doctor
from surfuse.pipeline.methods import method_lines as methods
from surfuse.pipeline.outcome import Outcome, SilentWatcher, Watcher
from surfuse.pipeline.replay import compare, fuse
from surfuse.pipeline.reporting import report, view
from surfuse.pipeline.reproduction import reproduce
from surfuse.pipeline.scoring import evaluate

__all__ = [
    "Outcome",
    "SilentWatcher",
    "Watcher",
    "acquire",
    "compare",
    "doctor",
    "evaluate",
    "export",
    "fuse",
    "methods",
    "report",
    "reproduce",
    "resume",
    "view",
]
