"""A model fitted to several parts of a record at once."""

import numpy as np
import pytest

from evopem import synthesis
from evopem.automatic import fit as module
from evopem.automatic.cross_validation.stretches import folds_of
from evopem.automatic.fit import FOLD_STAGES, fit, fits_of_parts
from evopem.errors import NoModelError
from evopem.estimation.pem.kernels import bfgs
from evopem.models.orders import Orders
from evopem.signals.recording import Segment

ORDERS = [
    Orders(na=4, nb=4, nc=2, nk=1),
    Orders(nb=2, nf=2, nk=1),
    Orders(nb=3, nc=1, nd=2, nf=2, nk=1),
    Orders(na=2, nb=3, nk=1),
]


@pytest.fixture(scope="module")
def record():
    recording, _ = synthesis.armax(seed=3, samples=700)
    return Segment(recording.inputs, recording.outputs)


def trainings(*records):
    """Parts of one and of several stretches."""
    designs = (2, 1), (5, 1), (2, 3)
    return [fold.training for d in designs for fold in folds_of(records, *d, shortest=5)]


def one_by_one(parts, model, structure, objective="quadratic"):
    return [fit(p, model.orders, objective, [model], False, structure, FOLD_STAGES) for p in parts]


@pytest.mark.parametrize("refresh", [bfgs.REFRESH, 1])
@pytest.mark.parametrize("objective", ["quadratic", "absolute"])
@pytest.mark.parametrize("orders", ORDERS, ids=str)
def test_all_parts_end_where_each_ends_alone(record, orders, objective, refresh, monkeypatch):
    """Also where inverse Hessians are approximated anew for those that have not ended."""
    monkeypatch.setattr(bfgs, "REFRESH", refresh)
    parts, model = trainings(record), fit([record], orders, objective).model
    expected = one_by_one(parts, model, orders.structure, objective)
    monkeypatch.setattr(module, "fit", None)  # none is left to be fitted alone
    found = fits_of_parts(parts, model, orders.structure, objective)
    for one, alone in zip(found, expected, strict=True):
        np.testing.assert_allclose(one.parameters, alone.model.parameters, rtol=1e-6, atol=1e-7)
        assert one.level == pytest.approx(alone.model.level, rel=1e-6, abs=1e-7)


def test_parts_of_several_recordings_have_their_levels(record):
    other = Segment(record.inputs, record.outputs + 5.0, 1)
    parts, model = trainings(record, other), fit([record, other], ORDERS[0]).model
    found = fits_of_parts(parts, model, "armax", "quadratic")
    for one, alone in zip(found, one_by_one(parts, model, "armax"), strict=True):
        np.testing.assert_allclose(one.parameters, alone.model.parameters, rtol=1e-6, atol=1e-7)
        assert one.level == pytest.approx(alone.model.level, rel=1e-6)


def test_a_part_that_begins_outside_the_stability_region_is_left_to_a_fit_of_its_own(
    record, monkeypatch
):
    orders, parts, asked = Orders(na=1, nb=1, nc=1, nk=1), trainings(record), []
    outside = module.model_of(orders, np.array([-1.01, 1.0, 0.0]))
    expected = one_by_one(parts, outside, "armax")
    alone = module.fit
    monkeypatch.setattr(module, "fit", lambda *given: asked.append(given) or alone(*given))
    found = fits_of_parts(parts, outside, "armax", "quadratic")
    assert len(asked) == len(parts)
    for one, each in zip(found, expected, strict=True):
        np.testing.assert_array_equal(one.parameters, each.model.parameters)


def test_a_part_without_a_long_stretch_has_no_model(record):
    model = fit([record], ORDERS[0]).model
    parts = [[record], [record.between(0, 4)]]
    with pytest.raises(NoModelError, match="no stretch has the"):
        fits_of_parts(parts, model, "armax", "quadratic")


def test_responses_of_parts_are_those_of_the_likeliest_priors(record):
    """Which a descent next to the prior of the first part finds."""
    orders = Orders("impulse", nb=20, nk=1)
    parts, model = trainings(record), fit([record], orders, structure="impulse").model
    found = fits_of_parts(parts, model, "impulse", "quadratic")
    for one, alone in zip(found, one_by_one(parts, model, "impulse"), strict=True):
        size = np.linalg.norm(alone.model.parameters)
        assert np.linalg.norm(one.parameters - alone.model.parameters) < 0.02 * size
