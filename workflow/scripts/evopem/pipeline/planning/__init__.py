"""What the rules of a workflow ask of a configuration: stages with files, arguments, resources.

Nothing here imports numpy, pandas or Snakemake, but the check of constraints numpy.
"""
