"""Settings of the search for state-space models."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal, get_args

from evopem.models.state_space import PlainStructure, StateSpaceStructure

Weighting = Literal["determinant", "noise", "power"]
Objective = Literal["quadratic", "absolute"]
STRUCTURES, PLAIN_STRUCTURES = get_args(StateSpaceStructure), get_args(PlainStructure)
WEIGHTINGS, OBJECTIVES = get_args(Weighting), get_args(Objective)


@dataclass(frozen=True)
class StateSpaceSettings:
    """Settings of the search for one state-space model.

    Attributes
    ----------
    weighting : {"determinant", "noise", "power"}
        ``determinant`` of the errors' covariance (maximum likelihood for white errors), each
        output by its own ``noise`` (the product of the variances), or by its ``power`` (the sum
        of the relative variances).
    max_root_radius : float
        Largest radius of the eigenvalues of A and of ``A - K C``.
    seed : int
        Seed of every random draw.
    objective : {"quadratic", "absolute"}
        ``absolute`` is robust to outliers.  Its outputs are weighed by their ``power``, and with
        any other weighting by their noise: the sum of the logarithms of mean absolute errors.
    evaluations : int, optional
        Evaluations after which no new generation starts; by default by the size of the problem.
        0 for descents from estimates alone.
    drift_period : float, optional
        Shortest period, in samples, of slow changes of the outputs that are estimated along with
        the level, and that the model does not have to explain.

    Raises
    ------
    ValueError
        When a setting is outside its range.
    """

    weighting: Weighting = "determinant"
    max_root_radius: float = 0.9999
    seed: int = 1
    objective: Objective = "quadratic"
    evaluations: int | None = None
    drift_period: float | None = None

    def __post_init__(self) -> None:
        for name, values in (("weighting", WEIGHTINGS), ("objective", OBJECTIVES)):
            value = getattr(self, name)
            if value not in values:
                raise ValueError(f"{name} must be one of {values}, not {value!r}")
        if not 0.0 < self.max_root_radius < 1.0:
            raise ValueError(
                f"max_root_radius must lie between 0 and 1, not {self.max_root_radius}"
            )
