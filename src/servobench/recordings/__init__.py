"""What was seen: a recording as it was written down, the files it comes in, and the data set that is made of it.

`recording` is the noun, with raw counts and never less. `native` reads and writes our own file, `formats` those of others, one
file for each. `measurement` has the stages of the chain, one file for each, and the verb `measure`, which makes a `Dataset` of a
recording; `boundedness` says whether one stayed bounded. It uses `core`: whoever reads a file needs no motor and no loop.

Public: `Recording`, `load`, `save`, `measure`, `bibo`.
"""
