"""Configuration: what a user wrote, checked and completed, and the grids that follow from it.

Nothing here imports numpy or pandas: a Snakefile uses this package.
"""
