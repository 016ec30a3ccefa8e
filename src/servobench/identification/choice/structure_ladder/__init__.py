"""The rungs of the ladder of structures: fitted one by one, compared with the fit below, and reported."""
