"""Do intervals cover between runs? Repeated experiments on one motor, and what makes them differ."""
