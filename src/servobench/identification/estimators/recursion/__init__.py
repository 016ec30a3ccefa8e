"""The parts of the recursive estimator: the motor sample by sample, the filters for each noise level, and their combination."""
