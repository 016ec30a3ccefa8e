"""Do intervals cover between runs? Repeated experiments on one motor, and the causes of their differences."""
