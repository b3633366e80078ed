"""Range sensors; every file is a plug-in."""
