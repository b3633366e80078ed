"""The servo cards between computer and arm: registers, scales, start-up calibration, servo loop; no plug-ins."""
