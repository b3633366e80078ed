"""The closed form of the PUMA 560 inverse kinematics and the choice among its solutions."""
