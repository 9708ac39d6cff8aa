"""The packages of the distribution; everything else about it is in pyproject.toml.

The templates of the report and the schema of the configuration belong to the workflow and stand
beside its scripts. The distribution holds them as two more packages, which no search below the
scripts would find.
"""

from setuptools import find_packages, setup

setup(packages=[*find_packages("workflow/scripts"), "evopem.templates", "evopem.schemas"])
