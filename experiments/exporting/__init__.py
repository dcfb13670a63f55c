"""Controllers that leave the simulator."""
