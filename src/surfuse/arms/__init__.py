"""Arms; every file is a plug-in."""
