"""Calibration of cameras, sensors and clocks."""
