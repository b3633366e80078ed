"""Fusion methods; every file is a plug-in."""
