"""Choice of form and order by scores on held-out samples."""

import numpy as np
import pytest

from evopem.automatic.state_space_choice import (
    Variant,
    VariantSearch,
    choose,
    decide_delays,
    noise_orders,
    searched_orders,
)
from evopem.config.state_space_settings import StateSpaceChoices
from evopem.errors import InputError
from evopem.signals.multichannel import MultichannelRecording

INNOVATIONS = Variant("innovations", "determinant")
OUTPUT_ERROR = Variant("output_error", "noise")
BOX_JENKINS = Variant("box_jenkins", "determinant")


def search(variant, simulation, prediction=None):
    orders = tuple(range(1, len(simulation) + 1))
    bic = tuple(-float(order) for order in orders)
    return VariantSearch(variant, orders, orders, bic, simulation, prediction or simulation)


def recording(samples, nu=2, ny=3):
    generator = np.random.default_rng(2)
    return MultichannelRecording(
        generator.standard_normal((samples, nu)),
        generator.standard_normal((samples, ny)),
        1.0,
        tuple(f"u{k}" for k in range(nu)),
        tuple(f"y{k}" for k in range(ny)),
        ("",) * nu,
        ("",) * ny,
    )


@pytest.mark.parametrize(
    ("output_error", "box_jenkins", "expected"),
    [
        ((40.0, 30.0, 29.9), (50.0, 31.0), (OUTPUT_ERROR, 2)),  # 1 % is not worth a state
        ((40.0, 39.0), (50.0, 37.5), (INNOVATIONS, 2)),  # a form has to gain 5 %
        ((40.0, 30.0), (20.0, 19.0), (BOX_JENKINS, 2)),
        ((np.inf, np.nan), (np.nan,), (INNOVATIONS, 2)),
    ],
)
def test_the_simplest_choice_near_the_lowest_error(output_error, box_jenkins, expected):
    searches = [
        search(INNOVATIONS, (60.0, 39.2)),
        search(OUTPUT_ERROR, output_error),
        search(BOX_JENKINS, box_jenkins),
    ]
    found = choose(searches, StateSpaceChoices())
    assert (found.variant, found.order) == expected
    assert found.purpose == "simulation"
    assert [each.subject for each in found.decisions] == ["form and weighting", "order"]


def test_the_purpose_decides_which_errors_count():
    searches = [
        search(INNOVATIONS, (50.0, 50.0), (5.0, 4.0)),
        search(OUTPUT_ERROR, (20.0, 20.0), (20.0, 20.0)),
    ]
    assert choose(searches, StateSpaceChoices()).variant == OUTPUT_ERROR
    found = choose(searches, StateSpaceChoices(purpose="prediction"))
    assert (found.variant, found.order) == (INNOVATIONS, 2)


def test_without_an_input_prediction_counts():
    alone = VariantSearch(INNOVATIONS, (1, 2), (1, 2), (-1.0, -2.0), (np.nan,) * 2, (9.0, 8.0))
    assert choose([alone], StateSpaceChoices()).order == 2
    assert decide_delays(recording(100, nu=0), None).delays == ()


def test_bic_decides_where_no_score_is_known():
    unknown = search(INNOVATIONS, (np.nan, np.inf, np.nan))
    assert choose([unknown], StateSpaceChoices()).order == 3


def test_orders_follow_the_length_of_the_record():
    assert searched_orders(recording(5000), None, "datasets.a") == tuple(range(2, 21, 2))
    assert searched_orders(recording(100), None, "datasets.a") == (1, 2, 3)
    assert searched_orders(recording(5000), (3, 5), "datasets.a") == (3, 4, 5)
    assert max(noise_orders(recording(100))) == 8
    with pytest.raises(InputError, match="30 estimation samples are too few"):
        searched_orders(recording(30), (4, 4), "datasets.a")


def test_delays_stay_within_their_limits():
    given = recording(300)
    y = given.outputs.copy()
    y[3:, 0] += 5.0 * given.inputs[:-3, 0]
    y[1:, 1] += 5.0 * given.inputs[:-1, 1]
    delayed = MultichannelRecording(
        given.inputs, y, 1.0, given.input_names, given.output_names, *(("",) * 2, ("",) * 3)
    )
    assert decide_delays(delayed, None).delays == (3, 1)
    assert decide_delays(delayed, (0, 2)).delays == (2, 1)
    assert decide_delays(delayed, (1, 1)).delays == (1, 1)
