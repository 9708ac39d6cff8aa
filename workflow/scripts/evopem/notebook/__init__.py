"""Identification from a notebook or a script: one call on a table, and an object with its results.

Everything runs in this process, by the same stages as the workflow, and no Snakemake is needed.
"""
