"""The twin behind the protocols of the makers: RTDE for an arm, pseudo-terminals, files of the kernel, the CAN bus."""
