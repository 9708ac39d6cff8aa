"""The residuals that tests use, of one stretch or of several.

Those of polynomials are of the estimation samples, where the derivatives of the residuals give the
distribution of the test after the fit (:func:`.residual_tests.whiteness_test`).  Those of a
state-space model are of the validation samples and need no correction for the fit.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from evopem.estimation.pem.polynomial_objective import PolynomialErrors
from evopem.models.polynomial import PolynomialModel
from evopem.models.polynomial_states import estimate_level, estimate_prediction_states
from evopem.signals.recording import Recording
from evopem.validation.responses import HeldOut

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class TestedResiduals:
    """Residuals, (N, l), and the inputs of the same samples, (N, m)."""

    residuals: Array
    inputs: Array
    bounds: tuple[int, ...]  # first residual of each stretch, and N
    # Gives the derivatives of the residuals of the one output by everything estimated, in blocks of
    # rows
    jacobian: Callable[[], Iterator[Array]] | None = None


def of_validation(held_out: Sequence[HeldOut]) -> TestedResiduals:
    """The residuals of the validation samples that are scored."""
    residuals = [(h.recording.outputs - h.predicted())[h.unscored :] for h in held_out]
    inputs = [h.recording.inputs[h.unscored :] for h in held_out]
    return TestedResiduals(np.concatenate(residuals), np.concatenate(inputs), _bounds(residuals))


def of_estimation(
    model: PolynomialModel, estimation: Recording, start: int, objective: str
) -> TestedResiduals:
    """The residuals of the estimation samples, of each stretch from sample ``start`` on.

    Each stretch begins with the states that fit it best, and each of several recordings has a
    level of its own.

    Raises ValueError when no stretch is long enough.
    """
    orders = model.orders
    first = orders.first_residual
    needed = max(start, first) + (1 if not estimation.is_joined else sum(orders.nf) + 2)
    stretches = [
        _Stretch.of(model, each, number, max(start, first), objective, estimation.is_joined)
        for each, number in zip(estimation.separated, estimation.segment_recordings, strict=True)
        if each.samples > needed
    ]
    if not stretches:
        raise ValueError(
            f"{estimation.samples} estimation samples leave no residuals from sample {start} on"
        )
    residuals = [each.residuals for each in stretches]
    inputs = np.concatenate([each.inputs for each in stretches])
    return TestedResiduals(
        np.concatenate(residuals)[:, None],
        inputs,
        _bounds(residuals),
        lambda: _jacobian(stretches, orders.parameters),
    )


@dataclass(frozen=True, eq=False)
class _Stretch:
    """The prediction-error problem of one stretch at a model, with its states and level."""

    errors: PolynomialErrors
    point: Array
    recording: int
    residuals: Array
    inputs: Array

    @classmethod
    def of(
        cls,
        model: PolynomialModel,
        stretch: Recording,
        number: int,
        start: int,
        objective: str,
        own_level: bool,
    ) -> _Stretch:
        u, y = stretch.inputs, stretch.output
        with_level = model.level != 0.0
        if with_level and own_level:
            model = replace(model, level=estimate_level(model, u, y))
        states = estimate_prediction_states(model, u, y)
        orders = model.orders
        errors = PolynomialErrors(
            *(
                np.ascontiguousarray(u),
                y,
                orders,
                objective,
                orders.first_residual,
                start,
                1.0,
                1.0,
            ),
            level=with_level,
        )
        levels = [model.level] if with_level else []
        point = np.concatenate([model.parameters, levels, *states])
        residuals = model.residuals(u, y, *states)[start:]
        return cls(errors, point, number, residuals, u[start:])


def _jacobian(stretches: Sequence[_Stretch], parameters: int) -> Iterator[Array]:
    """Derivatives by the parameters, the level of each recording and the states of each stretch."""
    numbers = sorted({each.recording for each in stretches})
    levels = len(numbers) if stretches[0].errors.level else 0
    states = [len(s.point) - parameters - bool(levels) for s in stretches]
    begin = parameters + levels
    for each, count in zip(stretches, states, strict=True):
        level = [parameters + numbers.index(each.recording)] if levels else []
        at = np.r_[np.arange(parameters), level, np.arange(begin, begin + count)].astype(int)
        begin += count
        for block in each.errors.jacobian_blocks(each.point):
            wide = np.zeros((len(block), parameters + levels + sum(states)))
            wide[:, at] = block
            yield wide


def _bounds(parts: Sequence[Array]) -> tuple[int, ...]:
    return tuple(np.cumsum([0, *map(len, parts)]).tolist())
