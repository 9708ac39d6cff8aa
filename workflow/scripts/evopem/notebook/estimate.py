"""Estimate a model of any structure: ``evopem.estimate``."""

from __future__ import annotations

import warnings
from collections.abc import Callable, Mapping
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike

from evopem.arrays import Array
from evopem.config.constraints import Constraints
from evopem.config.settings import OutputWeighting, ScoringWindow, SearchSettings
from evopem.config.structures import STATE_SPACE_FORMS, check_model
from evopem.estimation.estimate import estimate_polynomial
from evopem.models.constraint_checks import in_plain_numbers
from evopem.models.orders import orders_in_state_space, orders_of
from evopem.notebook.estimate_results import PolynomialResults
from evopem.signals.recording import Recording, recording_of

if TYPE_CHECKING:
    from evopem.notebook.state_space import StateSpaceResults

# Mean of a signal, in standard deviations, from which on it biases the poles noticeably.
LEVEL_WARNING = 0.3
# Share of an input that the inputs before it do not tell, below which it has nothing of its own.
DEPENDENT = 1e-9


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
    log: Callable[[str], None] | None = None,
) -> PolynomialResults | StateSpaceResults:
    """Find the model of a structure and orders with the smallest prediction errors, globally.

    Parameters
    ----------
    input, output : (N,), (N, m) and (N, l) array_like
        The signals; not modified.  ``input`` is None without an input, or a :class:`Recording`,
        which holds all signals, their rate, and segments that do not continue each other.
    orders : Orders, mapping or sequence
        ``{"na": 2, "nb": 2, "nc": 2, "nk": 1}``, or MATLAB's tuple for the structure; of nb, nf and
        nk one number for all inputs, or a sequence with one for each.  For state space the number
        of states, or with delays ``(4, [1, 3])`` or ``{"n": 4, "nk": [1, 3]}``.
    sampling_rate : float
        Hz.
    structure : str
        Of one output ``fir``, ``impulse``, a regularised response, ``arx``, ``arma``, ``armax``,
        ``ararx``, ``ararmax``, ``oe``, ``bj`` or ``general``; in state space ``ss``, innovations
        form with K, ``ss_oe``, output error with K = 0, ``ss_oe_drift``, the same beside slow
        changes of the level, or ``ss_bj``, an output-error plant with a noise model of its own.
    settings : SearchSettings, optional
    window : ScoringWindow, optional
        Of a polynomial model.
    level : bool
        Whether a constant is estimated along, for each recording.
    focus : {"prediction", "simulation"} or int
        The errors to be small: of one step, of simulation, or that many samples ahead.
    weighting : {"determinant", "noise", "power"}
        Of the outputs of a state-space model: ``determinant`` of the errors' covariance (maximum
        likelihood for white errors), each output by its own ``noise`` (the product of the
        variances), or by its ``power`` (the sum of the relative variances).
    constraints : Constraints, optional
        What the model must meet, and priors.
    log : callable, optional
        Receives one line a generation.

    Returns
    -------
    PolynomialResults or StateSpaceResults
        The estimate. Shown, it is a summary; it plots, compares, reports and saves itself as what
        :func:`evopem.identify` returns, judged by the same samples.

    Raises
    ------
    InputError
        When constraints contradict each other, the structure or the focus.
    ValueError
        When the recording is too short for the orders, or a setting is outside its range.

    Warns
    -----
    UserWarning
        When a signal has a mean beside its standard deviation, and the model has no level.

    Examples
    --------
    >>> import evopem
    >>> from evopem.synthesis import armax
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
    if not isinstance(structure, str):
        raise ValueError(f"structure must be a name, not {structure!r}")
    if not isinstance(settings, SearchSettings | None):
        raise ValueError(f"settings must be SearchSettings, not {settings!r}")
    recording = recording_of(input, output, sampling_rate)
    constraints = in_plain_numbers(constraints) if constraints else None
    if not level:
        _warn_of_level(recording.signals)
    _warn_of_inputs(recording)
    asked = recording, structure, level, settings, constraints
    shared: Any = {"level": level, "focus": focus, "constraints": constraints}
    shared |= {"settings": settings, "log": log}
    if structure in STATE_SPACE_FORMS:
        from evopem.estimation.state_space.estimate import estimate_state_space  # slow to load
        from evopem.notebook.state_space import StateSpaceResults

        if window is not None:
            raise ValueError("a window cannot be given: all samples of a state-space model count")
        of_model = orders_in_state_space(structure, orders)
        shared |= {"structure": structure, "weighting": weighting}
        delays = of_model.get("nk", 1)
        states = estimate_state_space(recording, of_model["n"], delays=delays, **shared)
        return StateSpaceResults(**vars(states), asked=(*asked, weighting))
    check_model(structure, len(recording.output_names) > 1, focus, constraints)
    if structure == "armax" and not recording.has_input:
        raise ValueError("structure 'armax' needs an input; without one, use 'arma'")
    given = orders_of(structure, orders, max(len(recording.input_names), 1))
    polynomials = estimate_polynomial(recording, given, window=window, **shared)
    return PolynomialResults(**vars(polynomials), asked=asked)


def _warn_of_level(signals: Mapping[str, Array]) -> None:
    """Warn of constant parts, which a model without a level has no term for."""
    for name, signal in signals.items():
        mean, deviation = signal.mean(), signal.std()
        # A constant signal is no level beside its changes.
        if LEVEL_WARNING * deviation < abs(mean) < deviation / DEPENDENT:
            warnings.warn(
                f"the mean of {name} is {mean:.3g}, with a standard deviation of"
                f" {deviation:.3g}: the model has no constant term, so set level=True, or subtract"
                " the means of input and output first",
                stacklevel=3,
            )


def _warn_of_inputs(recording: Recording) -> None:
    """Warn of inputs without an effect of their own: their dynamics follow from the noise."""
    moving = recording.inputs - recording.inputs.mean(axis=0)
    sizes = np.linalg.norm(recording.inputs, axis=0)
    triangle = np.linalg.qr(moving / np.where(sizes > 0.0, sizes, 1.0), mode="r")
    for name, size in zip(recording.input_names, np.abs(np.diag(triangle)), strict=True):
        if size < DEPENDENT:
            warnings.warn(
                f"input {name!r} is constant, or follows from the inputs before it: what a model"
                " says of it is chance, so leave it out",
                stacklevel=3,
            )
