"""The run folder: log, map, configuration, resume."""
