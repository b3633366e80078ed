"""Camera drivers; every file is a plug-in."""
