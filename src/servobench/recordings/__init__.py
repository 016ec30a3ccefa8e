"""What was seen: a recording as it was written down, the files it comes in, and the data set that is made of it.

`recording` is the noun, with raw counts and never less. `native` reads and writes our own file, `formats` those of others, one
file for each; `loading` lets libraries read theirs in a child process. `measurement` has the stages of the chain, one file for
each, and the verb `measure`, which makes a `Dataset` of a recording; `boundedness` says whether one stayed bounded.
Everything comes in the same way, for Python and for the command line: `adapters` make recordings of objects in memory, one file
for each kind, `arrays` of arrays that are given by name, `cells` makes numbers of either. `evidence` is a recording with columns,
units and chain known, `reading` takes the options that state them, `inspection` lists what is in a recording.
`streams` are rows that are still coming, of a motor that others drive, one file for each source. It uses `core`:
whoever reads a file needs no motor and no loop.

Public: `Recording`, `load`, `save`, `inspect`, `measure`, `bibo`.
"""
