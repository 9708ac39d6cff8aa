"""Configuration: what a user wrote, checked and completed, and the grids that follow from it.

Nothing here imports numpy or pandas: a Snakefile uses this package.
"""

from evopem.configuration.checking import check_schema, check_yaml_files
from evopem.configuration.code import code_version
from evopem.configuration.completion import complete
from evopem.configuration.grids import (
    PHASES,
    candidate_orders,
    part_count,
    previous_phase,
    scoring_start,
    widest_candidate_count,
)

__all__ = [
    "PHASES",
    "candidate_orders",
    "check_schema",
    "check_yaml_files",
    "code_version",
    "complete",
    "part_count",
    "previous_phase",
    "scoring_start",
    "widest_candidate_count",
]
