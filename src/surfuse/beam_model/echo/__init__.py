"""What a sensor hears of a surface, and when: beam, detector, first arrivals, free space."""
