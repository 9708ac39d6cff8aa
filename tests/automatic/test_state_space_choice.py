"""Choice of form and order by scores on held-out samples."""

from functools import partial
from types import SimpleNamespace

import numpy as np
import pytest

from evopem.automatic.delays import decide_delays
from evopem.automatic.searched_orders import searched_orders
from evopem.automatic.state_space_choice import choose
from evopem.automatic.variant_search import FoldErrors, Variant, VariantSearch, until_bic_rises
from evopem.config.settings import AutomaticSettings, InputRanges
from evopem.errors import InputError
from evopem.estimation.state_space.noise_model import noise_orders
from evopem.signals.recording import Recording

INNOVATIONS = Variant("ss", "determinant")
OUTPUT_ERROR = Variant("ss_oe", "noise")
BOX_JENKINS = Variant("ss_bj", "determinant")


def search(variant, simulation, prediction=None, free_level=None, bic=None, spread=0.0):
    """A search of orders 1, 2, ... with the given scores; folds differ by ``spread``."""
    orders = tuple(range(1, len(simulation) + 1))
    bic = bic or tuple(-float(order) for order in orders)
    scores = simulation, free_level or simulation, prediction or simulation
    folds = tuple(
        FoldErrors(*(tuple(s * (1.0 + spread * (-1) ** fold * s) for s in each) for each in scores))
        for fold in range(5)
    )
    return VariantSearch(variant, orders, orders, bic, bic, *scores, folds)


def recording(samples, nu=2, ny=3):
    generator = np.random.default_rng(2)
    return Recording(
        generator.standard_normal((samples, nu)),
        generator.standard_normal((samples, ny)),
        1.0,
        tuple(f"u{k}" for k in range(nu)),
        tuple(f"y{k}" for k in range(ny)),
        ("",) * nu,
        ("",) * ny,
    )


def chosen(searches, **choices):
    found = choose(searches, AutomaticSettings(**choices)).model
    return found.variant, found.order


@pytest.mark.parametrize(
    ("output_error", "box_jenkins", "expected"),
    [
        ((40.0, 30.0), (50.0, 33.0), (OUTPUT_ERROR, 2)),
        ((40.0, 39.0), (50.0, 37.0), (BOX_JENKINS, 2)),
        ((np.inf, np.nan), (np.nan,), (INNOVATIONS, 2)),
    ],
)
def test_held_out_samples_decide_between_forms(output_error, box_jenkins, expected):
    searches = [
        search(INNOVATIONS, (60.0, 39.2)),
        search(OUTPUT_ERROR, output_error),
        search(BOX_JENKINS, box_jenkins),
    ]
    assert chosen(searches) == expected


def test_the_likelihood_decides_between_models_that_held_out_samples_cannot_tell_apart():
    near = search(INNOVATIONS, (60.0, 31.0, 30.0), bic=(-1.0, -5.0, -4.0))
    far = search(OUTPUT_ERROR, (60.0, 33.0), bic=(-1.0, -9.0))
    assert chosen([near, far]) == (INNOVATIONS, 2)
    # The folds differ from each other by far more than the orders do.
    varying = search(OUTPUT_ERROR, (29.0, 33.0), bic=(-1.0, -9.0), spread=0.03)
    assert chosen([near, varying]) == (OUTPUT_ERROR, 2)


def test_one_step_errors_do_not_decide_which_form_simulates():
    likely = search(INNOVATIONS, (60.0, 31.0), bic=(-1.0, -9.0))
    simulating = search(OUTPUT_ERROR, (60.0, 30.0), bic=(-1.0, -2.0))
    assert chosen([likely, simulating]) == (OUTPUT_ERROR, 2)
    assert chosen([likely, simulating], purpose="prediction") == (INNOVATIONS, 2)


def test_a_level_is_fitted_to_other_samples_where_it_drifts():
    drifting = search(INNOVATIONS, (60.0, 80.0), free_level=(40.0, 30.0))
    found = choose([drifting], AutomaticSettings())
    assert (found.model.level, found.model.order) == ("state", 2)
    steady = search(INNOVATIONS, (60.0, 80.0), free_level=(59.0, 79.0))
    assert choose([steady], AutomaticSettings()).model.level == "constant"


def test_each_purpose_has_a_model():
    searches = [
        search(INNOVATIONS, (50.0, 50.0), (5.0, 4.0)),
        search(OUTPUT_ERROR, (20.0, 20.0), (20.0, 20.0)),
    ]
    found = choose(searches, AutomaticSettings())
    assert (found.model.purpose, found.model.variant) == ("simulation", OUTPUT_ERROR)
    other = choose(searches, AutomaticSettings(purpose="prediction"))
    assert (other.model.variant, other.model.order) == (INNOVATIONS, 2)
    assert (other.model, other.other) == (found.other, found.model)


def test_without_an_input_prediction_counts():
    unknown = (np.nan,) * 2
    alone = search(INNOVATIONS, unknown, (9.0, 8.0), unknown)
    found = choose([alone], AutomaticSettings())
    assert (found.model.order, found.model.purpose, found.other) == (2, "prediction", None)
    assert decide_delays(recording(100, nu=0).segments, ()).delays == ()


def test_bic_decides_where_no_score_is_known():
    unknown = search(INNOVATIONS, (np.nan, np.inf, np.nan))
    assert chosen([unknown, search(OUTPUT_ERROR, (np.nan,))]) == (INNOVATIONS, 3)


@pytest.mark.parametrize(
    ("orders", "bic", "coloured", "last"),
    [
        # Two rises end a search; a single one does not.
        (range(2, 21, 2), (9, 8, 8.5, 7, 7.5, 7.2, 3, 2, 1, 0), (0,) * 10, 12),
        # Beyond 20 states the first one does, of either criterion.
        (range(16, 31, 2), (9, 8, 7, 6, 5, 5.5, 4, 3), (9, 8, 7, 6, 5, 4, 3, 2), 26),
        (range(16, 31, 2), (9, 8, 7, 6, 5, 4, 3, 2), (9, 8, 7, 6, 6.5, 6, 5, 4), 24),
        # Errors that stay coloured alike do not add states without end.
        (range(16, 31, 2), (9, 8, 7, 6, 5, 4, 3, 2), (5, 6, 7, 8, 9, 9, 9, 9), 20),
        ((30,), (1,), (1,), 30),
    ],
)
def test_a_search_over_orders_ends_where_bic_rises(orders, bic, coloured, last):
    scores = zip(orders, bic, coloured, strict=True)
    estimates = ((order, SimpleNamespace(bic=b, coloured_bic=c)) for order, b, c in scores)
    assert max(until_bic_rises(estimates)) == last


def test_orders_follow_the_length_of_the_record():
    assert searched_orders(recording(5000), None) == tuple(range(2, 41, 2))
    assert searched_orders(recording(100), None) == (1, 2, 3)
    assert searched_orders(recording(5000), (3, 5)) == (3, 4, 5)
    # Five folds leave four fifths of a short record to fit.
    assert searched_orders(recording(160, 5, 3), None) == tuple(range(1, 7))
    assert max(noise_orders(recording(100))) == 8
    with pytest.raises(InputError, match="30 estimation samples are too few"):
        searched_orders(recording(30), (4, 4))


def test_delays_stay_within_their_limits():
    given = recording(300)
    y = given.outputs.copy()
    y[3:, 0] += 5.0 * given.inputs[:-3, 0]
    y[1:, 1] += 5.0 * given.inputs[:-1, 1]
    delayed = Recording(
        given.inputs, y, 1.0, given.input_names, given.output_names, *(("",) * 2, ("",) * 3)
    )
    decided = partial(decide_delays, delayed.segments, delayed.input_names)
    assert decided().delays == (3, 1)
    assert decided(InputRanges((0, 2))).delays == (2, 1)
    assert decided(InputRanges((1, 1))).delays == (1, 1)
