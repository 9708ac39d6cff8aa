"""What the rules of the workflow ask of a configuration; nothing here loads numpy or Snakemake."""
