"""One module for each file format, with two functions.

``read(path, references) -> list[Channel]`` reads channels; ``names(path) -> list[str]`` lists them.

A module and the library behind it are imported only when a file of that format is read.
"""
