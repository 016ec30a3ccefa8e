"""`servobench fleet`: a group of commands, each in a file of its own; `group` lists them."""
