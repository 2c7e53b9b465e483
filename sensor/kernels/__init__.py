"""Every jitted kernel of the sensor: the paper's equations, and the bus."""
