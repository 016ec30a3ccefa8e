"""Reports: a result for people to read, in one file that opens from disk without a network."""
