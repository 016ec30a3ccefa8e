"""The causes that are weighed, one a file."""
