"""The workflow, for `snakemake` in this folder: it finds profiles/default beside this file."""


include: "workflow/Snakefile"
