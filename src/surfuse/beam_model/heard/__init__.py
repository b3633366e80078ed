"""What was heard: stations, wavefronts, the domain that they cover."""
