"""Estimate a model of any structure: the function behind ``evopem.estimate``."""

from __future__ import annotations

import warnings
from collections.abc import Callable, Mapping, Sequence
from typing import Any, overload

import numpy as np
from numpy.typing import ArrayLike, NDArray

from evopem.config.constraints import Constraints
from evopem.config.settings import OutputWeighting, ScoringWindow, SearchSettings
from evopem.estimation.polynomial_estimate import PolynomialEstimate
from evopem.estimation.polynomial_search import estimate_polynomial
from evopem.estimation.search.certificate import Target
from evopem.estimation.search.problem import SearchResult
from evopem.estimation.state_space.estimate import estimate_state_space
from evopem.estimation.state_space.local_estimates import STRUCTURES, StateSpaceEstimate
from evopem.models.state_space import StateSpaceStructure
from evopem.models.structures import Orders, orders_of
from evopem.signals.recording import Recording, recording_of

Array = NDArray[np.float64]

# Mean of the output, in standard deviations, from which on it biases the poles noticeably.
LEVEL_WARNING = 0.3


@overload
def estimate(  # type: ignore[overload-overlap]
    input: ArrayLike | Recording | None,
    output: ArrayLike | None = None,
    orders: int | Mapping[str, Any] | None = None,
    sampling_rate: float = 1.0,
    *,
    structure: StateSpaceStructure,
    settings: SearchSettings | None = None,
    level: bool = False,
    focus: str | int = "prediction",
    weighting: OutputWeighting = "determinant",
    constraints: Constraints | None = None,
    log: Callable[[str], None] | None = None,
) -> StateSpaceEstimate: ...


@overload
def estimate(
    input: ArrayLike | Recording | None,
    output: ArrayLike | None = None,
    orders: Orders | Mapping[str, Any] | Sequence[Any] | None = None,
    sampling_rate: float = 1.0,
    *,
    structure: str = "armax",
    settings: SearchSettings | None = None,
    window: ScoringWindow | None = None,
    level: bool = False,
    focus: str | int = "prediction",
    weighting: OutputWeighting = "determinant",
    constraints: Constraints | None = None,
    earlier: SearchResult | None = None,
    log: Callable[[str], None] | None = None,
    target: Target | None = None,
) -> PolynomialEstimate: ...


def estimate(
    input: ArrayLike | Recording | None,  # noqa: A002 - the field's word
    output: ArrayLike | None = None,
    orders: Any = None,
    sampling_rate: float = 1.0,
    *,
    structure: str = "armax",
    settings: SearchSettings | None = None,
    window: ScoringWindow | None = None,
    level: bool = False,
    focus: str | int = "prediction",
    weighting: OutputWeighting = "determinant",
    constraints: Constraints | None = None,
    earlier: SearchResult | None = None,
    log: Callable[[str], None] | None = None,
    target: Target | None = None,
) -> PolynomialEstimate | StateSpaceEstimate:
    """Find the model of a structure and orders with the smallest prediction errors, globally.

    Parameters
    ----------
    input, output : (N,), (N, m) and (N, l) array_like
        The signals; not modified.  ``input`` is None without an input, or a :class:`Recording`,
        which holds all signals, their rate, and segments that do not continue each other.
    orders : Orders, mapping or sequence
        ``{"na": 2, "nb": 2, "nc": 2, "nk": 1}``, or MATLAB's tuple for the structure; of nb, nf and
        nk one number for all inputs, or a sequence with one for each.  For state space the number
        of states, or ``{"n": 4, "nk": [1, 3]}`` with delays.
    sampling_rate : float
        Hz.
    structure : str
        A key of :data:`evopem.config.structures.STRUCTURES`: ``fir``, ``arx``, ``arma``,
        ``armax``, ``ararx``, ``ararmax``, ``oe``, ``bj`` or ``general``, of one output; or ``ss``,
        ``ss_oe``, ``ss_oe_drift`` or ``ss_bj``.
    settings : SearchSettings, optional
    window : ScoringWindow, optional
        Of a polynomial model.
    level : bool
        Whether a constant is estimated along, for each recording.
    focus : {"prediction", "simulation"} or int
        The errors to be small: of one step, of simulation, or of predictions that many samples
        ahead.
    weighting : {"determinant", "noise", "power"}
        Of the outputs of a state-space model; see :func:`.estimate_state_space`.
    constraints : Constraints, optional
        What the model must meet, and priors.
    earlier : SearchResult, optional
        Result of an earlier search of the same problem, to be combined with this one; as `target`
        of a polynomial model.
    log : callable, optional
        Receives one line a generation.
    target : Target, optional
        What the search is made for: it ends once it is unlikely to get so low.

    Returns
    -------
    PolynomialEstimate or StateSpaceEstimate

    Raises
    ------
    InputError
        When constraints contradict each other, the structure or the focus.
    ValueError
        When the record is too short for the orders, or a setting is outside its range.

    Warns
    -----
    UserWarning
        When the mean of the output is not small beside its standard deviation, and the model has no
        level.

    Examples
    --------
    >>> import evopem
    >>> from evopem.synthesis.armax import armax
    >>> recording, truth = armax(seed=1, samples=1000)
    >>> found = evopem.estimate(
    ...     recording,
    ...     orders=(7, 6, 7, 3),
    ...     settings=evopem.SearchSettings(objective="quadratic", seed=1),
    ... )
    >>> [round(mode.frequency_hz) for mode in found.model.modes()]
    [5, 17, 37]
    """
    if orders is None:
        raise ValueError("orders are missing, such as orders=(2, 2, 2, 1)")
    recording = recording_of(input, output, sampling_rate)
    given = {"window": window, "earlier": earlier, "target": target}
    expert = [name for name, each in given.items() if each is not None]
    if structure in STRUCTURES:
        _refuse(expert, "all samples of a state-space model count, with its initial states")
        of_model = {"n": orders} if isinstance(orders, int) else dict(orders)
        return estimate_state_space(
            recording,
            of_model["n"],
            structure=structure,  # type: ignore[arg-type]
            delays=of_model.get("nk", 1),
            level=level,
            focus=focus,
            weighting=weighting,
            constraints=constraints,
            settings=settings,
            log=log,
        )
    if len(recording.output_names) > 1:
        raise ValueError(
            f"a polynomial model has one output, and there are {len(recording.output_names)};"
            " estimate one for each, or a state-space model (structure='ss') of all"
        )
    if not level:
        _warn_of_level(recording.output)
    if structure == "armax" and not recording.has_input:
        raise ValueError("structure 'armax' needs an input; without one, use 'arma'")
    return estimate_polynomial(
        recording,
        orders_of(structure, orders, max(len(recording.input_names), 1)),
        settings=settings,
        window=window,
        level=level,
        focus=focus,
        constraints=constraints,
        earlier=earlier,
        log=log,
        target=target,
    )


def _warn_of_level(output: Array) -> None:
    """Warn of a constant part, which a model without a level has no term for."""
    mean, deviation = float(np.mean(output)), float(np.std(output))
    if abs(mean) > LEVEL_WARNING * deviation:
        warnings.warn(
            f"the mean of the output is {mean:.3g}, with a standard deviation of {deviation:.3g}: "
            "the model has no constant term, so set level=True, or subtract the means of input and"
            " output first",
            stacklevel=3,
        )


def _refuse(expert: Sequence[str], why: str) -> None:
    if expert:
        raise ValueError(f"{' and '.join(expert)} cannot be given: {why}")
