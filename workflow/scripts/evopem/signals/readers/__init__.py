"""One module a file format, each with ``read(path, references) -> list[Channel]``.

A module is imported only when a file of its format is read, and so is the library behind it.
"""
