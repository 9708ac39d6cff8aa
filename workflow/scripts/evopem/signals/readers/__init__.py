"""One module for each file format; each has one function, `opened`, see `channels.Contents`.

A module and the library behind it are imported only when a file of that format is read.
"""
