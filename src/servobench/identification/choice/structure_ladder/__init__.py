"""The rungs of the ladder of structures: tried one by one, compared with the fit below, and told of."""
