"""The stages of an identification: each reads its files, calls the package, and writes its files.

Each stage has a module of its own, so that a change of code reruns only the stages that use it.
"""
