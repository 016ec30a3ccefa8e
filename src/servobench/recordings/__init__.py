"""Recordings: the raw data of a run, the files they come in, and the data set made from them.

`recording` is the noun, always with raw counts, `row_store` gathers its rows. `native` reads and writes servobench's own file,
`formats` foreign ones, one file for each; `loading` runs the libraries that read some of them, in a child process.
`measurement` has the stages of the chain, one file for each, and the verb `measure`, which turns a recording into a `Dataset`;
`boundedness` says whether a recording stayed bounded. Python and the command line read data in the same way: `adapters` turn
objects in memory into recordings, one file for each kind, `arrays` does this for arrays given by name, and `cells` parses their
values. `evidence` is a recording with known columns, units and chain, `reading` has the options that state them, and
`inspection` lists the contents of a recording. `streams` are rows that still come, one file for each source. It uses `core`: to
read a file you need no motor and no loop.

Public: `Recording`, `load`, `save`, `inspect`, `measure`, `bibo`.
"""
