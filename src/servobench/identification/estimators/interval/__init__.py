"""The parts of the interval likelihood: what a bin says, the search, the noise before rounding, the test for a torque."""
