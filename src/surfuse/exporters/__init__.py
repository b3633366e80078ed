"""File formats of maps; every file is a plug-in, reader and writer together."""
