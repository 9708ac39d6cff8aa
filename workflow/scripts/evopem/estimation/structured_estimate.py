"""Estimate a model of any structure: the function behind ``evopem.estimate``."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Literal, overload

from numpy.typing import ArrayLike

from evopem.config.constraints import Constraints
from evopem.config.settings import ScoringWindow, SearchSettings
from evopem.estimation import estimate as armax
from evopem.estimation.estimate import Estimate
from evopem.estimation.focused_estimate import estimate_focused
from evopem.estimation.polynomial_estimate import PolynomialEstimate, estimate_polynomial
from evopem.estimation.search.problem import SearchResult
from evopem.models.armax import Orders
from evopem.models.structures import PolynomialOrders, orders_of

# Every structure but "armax", which has an estimate and a search of its own.
PolynomialStructure = Literal["fir", "arx", "arma", "ararx", "ararmax", "oe", "bj", "general"]


@overload
def estimate(
    input: ArrayLike,
    output: ArrayLike,
    orders: Orders | Mapping[str, int] | Sequence[int],
    sampling_rate: float = 1.0,
    *,
    structure: Literal["armax"] = "armax",
    settings: SearchSettings | None = None,
    window: ScoringWindow | None = None,
    earlier: SearchResult | None = None,
    log: Callable[[str], None] | None = None,
) -> Estimate: ...


@overload
def estimate(
    input: ArrayLike,
    output: ArrayLike,
    orders: Orders | PolynomialOrders | Mapping[str, int] | Sequence[int],
    sampling_rate: float = 1.0,
    *,
    structure: Literal["armax"] = "armax",
    settings: SearchSettings | None = None,
    window: ScoringWindow | None = None,
    level: bool = False,
    focus: str | int = "prediction",
    constraints: Constraints | None,
    log: Callable[[str], None] | None = None,
) -> PolynomialEstimate: ...


@overload
def estimate(
    input: ArrayLike | None,
    output: ArrayLike,
    orders: PolynomialOrders | Mapping[str, int] | Sequence[int],
    sampling_rate: float = 1.0,
    *,
    structure: PolynomialStructure,
    settings: SearchSettings | None = None,
    window: ScoringWindow | None = None,
    level: bool = False,
    focus: str | int = "prediction",
    constraints: Constraints | None = None,
    log: Callable[[str], None] | None = None,
) -> PolynomialEstimate: ...


def estimate(
    input: ArrayLike | None,  # noqa: A002 - the field's word
    output: ArrayLike,
    orders: Orders | PolynomialOrders | Mapping[str, int] | Sequence[int],
    sampling_rate: float = 1.0,
    *,
    structure: str = "armax",
    settings: SearchSettings | None = None,
    window: ScoringWindow | None = None,
    level: bool = False,
    focus: str | int = "prediction",
    constraints: Constraints | None = None,
    earlier: SearchResult | None = None,
    log: Callable[[str], None] | None = None,
) -> Estimate | PolynomialEstimate:
    """Find the model of a structure and orders with the smallest prediction errors, globally.

    Parameters
    ----------
    input, output : (N,) array_like
        The record; not modified.  ``input`` is None for ``structure="arma"``.
    orders : Orders, PolynomialOrders, mapping or sequence
        ``{"na": 2, "nb": 2, "nc": 2, "nk": 1}``, or MATLAB's tuple for the structure.
    sampling_rate : float
        Hz.
    structure : str
        A key of :data:`evopem.models.structures.STRUCTURES`: ``fir``, ``arx``, ``arma``,
        ``armax``, ``ararx``, ``ararmax``, ``oe``, ``bj`` or ``general``.
    settings : SearchSettings, optional
    window : ScoringWindow, optional
    level : bool
        Whether a constant is estimated along; for all structures but ``armax``.
    focus : {"prediction", "simulation"} or int
        The errors to be small: of one step, of simulation, or of predictions that many samples
        ahead.
    constraints : Constraints, optional
        What the model must meet, and priors.
    earlier : SearchResult, optional
        Result of an earlier search of the same problem; for ``armax`` alone.
    log : callable, optional
        Receives one line a generation.

    Returns
    -------
    Estimate or PolynomialEstimate
        For ``armax``, of :func:`evopem.estimation.estimate.estimate`; for the other structures, of
        :func:`evopem.estimation.polynomial_estimate.estimate_polynomial`; with a focus or
        constraints, of :func:`evopem.estimation.focused_estimate.estimate_focused` for all.

    Raises
    ------
    InputError
        When constraints contradict each other, the structure or the focus.
    ValueError
        When the record is too short for the orders, or a setting is outside its range.

    Examples
    --------
    >>> import evopem
    >>> from evopem.synthesis.armax import armax
    >>> recording, truth = armax(seed=1, samples=1000)
    >>> found = evopem.estimate(
    ...     recording.input,
    ...     recording.output,
    ...     orders=(7, 6, 7, 3),
    ...     sampling_rate=100.0,
    ...     settings=evopem.SearchSettings(objective="quadratic", seed=1),
    ... )
    >>> [round(mode.frequency_hz) for mode in found.model.modes()]
    [5, 17, 37]
    """
    if focus != "prediction" or constraints is not None:
        if earlier is not None:
            raise ValueError("an earlier search is not continued with a focus or constraints")
        return estimate_focused(
            input,
            output,
            structure,
            _of_any_structure(orders),
            sampling_rate,
            settings=settings,
            window=window,
            level=level,
            focus=focus,
            constraints=constraints,
            log=log,
        )
    if structure == "armax":
        if level:
            raise ValueError(
                "structure 'armax' is estimated without a level; use structure 'general' with the "
                "same orders, or remove the mean of the signals"
            )
        if input is None:
            raise ValueError("structure 'armax' needs an input; without one, use 'arma'")
        if not isinstance(orders, Orders):
            o = orders_of(structure, orders)
            orders = Orders(o.na, o.nb, o.nc, o.nk)
        return armax.estimate(
            input,
            output,
            orders,
            sampling_rate,
            settings=settings,
            window=window,
            earlier=earlier,
            log=log,
        )
    if earlier is not None:
        raise ValueError(f"an earlier search is continued for 'armax' alone, not for {structure!r}")
    return estimate_polynomial(
        input,
        output,
        structure,
        _of_any_structure(orders),
        sampling_rate,
        settings=settings,
        window=window,
        level=level,
        log=log,
    )


def _of_any_structure(
    orders: Orders | PolynomialOrders | Mapping[str, int] | Sequence[int],
) -> PolynomialOrders | Mapping[str, int] | Sequence[int]:
    if isinstance(orders, Orders):
        return PolynomialOrders(na=orders.na, nb=orders.nb, nc=orders.nc, nk=orders.nk)
    return orders
