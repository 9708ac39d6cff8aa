"""One module for each file format, with a function ``read(path, references) -> list[Channel]``.

A module and the library behind it are imported only when a file of that format is read.
"""
