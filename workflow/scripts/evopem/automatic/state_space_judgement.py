"""What the checks say of a model of several channels on its estimation samples.

The validation samples decide nothing.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.special import ndtri

from evopem.automatic.searched_forms import SearchedForms
from evopem.automatic.trials import DELAY
from evopem.estimation.multi_input.order_limits import OrderLimits
from evopem.models.state_space import StateSpaceModel
from evopem.validation.checks.check import SIGNIFICANCE
from evopem.validation.checks.residuals import INDEPENDENT_OF_INPUT, WHITE
from evopem.validation.checks.roots import INSIDE_BOUND
from evopem.validation.checks.state_space import coloured_outputs, dependent_pairs
from evopem.validation.multichannel import validate_multichannel
from evopem.validation.residual_tests import correlation_with_input

# Checks that hold or fail by the residuals and roots of a model.
OF_RESIDUALS = (DELAY, WHITE, INDEPENDENT_OF_INPUT, INSIDE_BOUND)


@dataclass(frozen=True)
class Judgement:
    """What the checks say of a model on its estimation samples.

    Attributes
    ----------
    failed : frozenset of str
    whiteness : float
        Lowest p-value of the outputs.
    correlation : float
        Largest cross-correlation of residuals and an input, in its 95 % bounds.
    delays : tuple of int
        The delays, or earlier ones where residuals depend on samples of an input before them.
    """

    failed: frozenset[str]
    whiteness: float
    correlation: float
    delays: tuple[int, ...]


def judge(model: StateSpaceModel, at_bound: bool, forms: SearchedForms) -> Judgement:
    """The checks of a model by its residuals of the estimation samples.

    Parameters
    ----------
    model : StateSpaceModel
        With its noise model.
    at_bound : bool
        Whether a root lies at the largest radius allowed.
    forms : SearchedForms
        Behind it.
    """
    estimation = forms.estimation
    validation, _ = validate_multichannel(model, estimation, fitted=model.order)
    delays = _earlier_delays(model, forms)
    failed = {
        DELAY: delays != forms.delays,
        WHITE: bool(np.any(model.K)) and bool(coloured_outputs(validation)),
        INDEPENDENT_OF_INPUT: bool(dependent_pairs(validation)),
        INSIDE_BOUND: at_bound,
    }
    return Judgement(
        frozenset(name for name, fails in failed.items() if fails),
        min(each.ljung_box_p for each in validation.outputs),
        max((each.max_in_bounds for each in validation.pairs), default=0.0),
        delays,
    )


def _earlier_delays(model: StateSpaceModel, forms: SearchedForms) -> tuple[int, ...]:
    """The delays, earlier where residuals depend on samples of an input before its delay.

    A dependence on later samples is one of the response, and no fault of the delay.
    """
    estimation, delays = forms.estimation, forms.delays
    limits = OrderLimits.of(forms.ranges, estimation.input_names).nk if delays else ()
    least = [each[0] if each else 0 for each in limits]
    tested = model.outputs * sum(np.subtract(delays, least))
    if tested == 0:
        return delays
    allowed = float(ndtri(1 - SIGNIFICANCE / (2 * tested)) / ndtri(0.975))
    residuals = np.concatenate(
        [
            model.residuals(u, y, model.prediction_state(u, y))
            for u, y in zip(estimation.segment_inputs, estimation.segment_outputs, strict=True)
        ]
    )
    earlier = list(delays)
    for column, (delay, lowest) in enumerate(zip(delays, least, strict=True)):
        for e in residuals.T:
            u = estimation.inputs[:, column]
            found = correlation_with_input(e, u, max(delay, 1), estimation.bounds)
            large = np.abs(found.values) > allowed * found.bound95
            before = found.lag[large & (found.lag >= lowest) & (found.lag < delay)]
            earlier[column] = min([earlier[column], *before.tolist()])
    return tuple(earlier)
