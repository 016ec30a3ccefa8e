"""The verb `load`: files that aren't plain text are read by their libraries, in a child process with limits."""
