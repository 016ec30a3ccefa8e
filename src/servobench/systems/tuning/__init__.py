"""Gains of a controller from an identified motor: the kind of the methods, and the verb `tune`."""
