"""surfuse: a surface profiler from a robot arm, a camera and cheap range sensors."""

__version__ = "0.1.0"
