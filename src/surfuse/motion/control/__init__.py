"""Control laws; every file is a plug-in."""
