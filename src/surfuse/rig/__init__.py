"""The rig: its devices and where they sit, described by a cell file, assembled real or simulated."""
