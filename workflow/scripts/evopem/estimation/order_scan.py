"""Orders by one number, and the optimum next to a model, with a level for each recording."""

from __future__ import annotations

from collections.abc import Sequence

from evopem.blas_threads import one_blas_thread
from evopem.config.settings import ScoringWindow, SearchSettings
from evopem.config.structures import STRUCTURES
from evopem.errors import NoModelError
from evopem.estimation.polynomial_estimate import PolynomialEstimate, describe
from evopem.estimation.prediction_errors import checked_errors, in_scaled_units, scaled_errors
from evopem.estimation.search.polynomial_problem import PolynomialProblem
from evopem.estimation.search.problem import SearchDiagnostics, SearchResult
from evopem.models.polynomial import PolynomialModel
from evopem.models.structures import Orders
from evopem.signals.recording import Recording

# Largest order of the noise that follows the joint order where D stands beside C or A.
MOST_NOISE = 4
# Orders of A of the general structure, whose F_i have the joint order.
SHARED_POLES = 1


def joint_orders(structure: str, order: int, delays: Sequence[int]) -> Orders:
    """Orders of a structure that one number k determines.

    na = nb = nc = k; of structures with F_i, nb = nf = k.  Where D stands beside C or A, their
    orders are at most :data:`MOST_NOISE`.

    Examples
    --------
    >>> print(joint_orders("armax", 3, (1, 2)), joint_orders("bj", 6, (1, 2)))
    ARMAX(3,[3 3],3,[1 2]) BJ([6 6],4,4,[6 6],[1 2])
    """
    names, nu = STRUCTURES[structure], len(delays)
    noise = min(order, MOST_NOISE) if "nd" in names else order
    shared = SHARED_POLES if structure == "general" else order
    return Orders(
        structure,
        nb=(order,) * nu,
        nf=(order if "nf" in names else 0,) * nu,
        nk=tuple(delays),
        na=shared if "na" in names else 0,
        nc=noise if "nc" in names else 0,
        nd=noise if "nd" in names else 0,
    )


def refitted_estimate(
    model: PolynomialModel, recording: Recording, settings: SearchSettings
) -> PolynomialEstimate:
    """The optimum of a recording that a descent from a model ends at, or NoModelError."""
    start = model.orders.first_residual
    window = ScoringWindow(start, start)
    with one_blas_thread():
        errors = checked_errors(recording, model.orders, settings, window, level=True)
        scaled, units = scaled_errors(errors)
        models = [in_scaled_units(model, units)]
        problem = PolynomialProblem(scaled, models, own_starts=False)
        starts = problem.starts()[:1]
        if not len(starts):
            raise NoModelError("the descent found no finite errors")
        descents = problem.descend(starts)
        value = float(descents.values[0])
        diagnostics = SearchDiagnostics.of_descents(value, descents.evaluations, 1)
        found = SearchResult(units.restored(descents.points[0]), value, diagnostics)
        return describe(errors, found, recording.sampling_rate, shortest=True)
