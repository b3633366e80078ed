"""What is installed and connected here, and the program of a sensor node."""
