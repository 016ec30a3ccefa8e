"""The kind `export`: forms in which other programs take an identified motor, each in the file of its name."""
