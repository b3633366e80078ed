"""Dynamics of the twin's arm: the plant behind the servo cards."""
