"""Modes with their evidence on truths: what is found, what is doubted, who drives a mode."""

from dataclasses import replace

import numpy as np
import pytest
from vibrating_structure import VibratingStructure

from evopem.estimation.state_space.estimate import estimates_of_orders
from evopem.files.json_form import from_json, to_json
from evopem.models.mode_matching import OrderModel
from evopem.models.modes import assurance
from evopem.models.state_space import StateSpaceModel
from evopem.signals.recording import Recording, recording_of
from evopem.validation.modal_parts import held_out_mode_tests
from evopem.validation.mode_evidence import (
    ModeTable,
    doubts,
    mode_table,
    table_of_models,
)
from evopem.validation.responses import divided

RATE = 100.0
CLOSE = VibratingStructure(
    frequencies_hz=np.array([5.0, 12.0, 12.4]),
    damping_ratios=np.array([0.02, 0.015, 0.015]),
    shapes=np.array([[1.0, 0.5, 0.2], [0.6, -1.0, 0.5], [0.3, 0.4, -1.0]]),
)


@pytest.fixture(scope="module")
def ambient():
    """The table of a record of outputs alone with 20 % of sensor noise."""
    y = CLOSE.ambient_record(3000, RATE, 0.2, np.random.default_rng(3))
    orders = range(2, 13, 2)
    recording = recording_of(None, y, RATE)
    estimates = list(estimates_of_orders(recording.between(0, 2200), orders, width=3))
    return estimates, mode_table(estimates, recording, 2200)


def test_exactly_the_true_modes_of_an_output_only_record_are_trusted(ambient):
    _, table = ambient
    assert table.order == 6
    assert len(table.trusted) == 3
    for k, mode in enumerate(table.trusted):
        assert abs(mode.frequency_hz - CLOSE.frequencies_hz[k]) < 4.0 * mode.frequency_se_hz
        assert abs(mode.damping_ratio - CLOSE.damping_ratios[k]) < 4.0 * mode.damping_se
        assert assurance(mode.shape, CLOSE.shapes[:, k].astype(complex)) > 0.95
    for judged in table.modes:
        assert judged.origin == ("noise" if judged.trusted else judged.origin)
        assert not judged.has_input
    own = [pole for pole in table.poles if pole.mode is not None and pole.order >= 6]
    assert {pole.order for pole in own} == {6, 8, 10, 12}


def test_a_pole_without_which_a_smaller_model_predicts_as_well_is_not_trusted(ambient):
    estimates, _ = ambient
    models = [OrderModel.of(each.model.order, each.bic, each.model) for each in estimates]
    y = CLOSE.ambient_record(900, RATE, 0.2, np.random.default_rng(5))
    recording = recording_of(None, y, RATE)
    for order in (10, 12):
        table = table_of_models(models, order, lambda model: divided(model, recording, 0))
        for each in table.modes:
            if each.trusted:
                assert np.abs(CLOSE.frequencies_hz / each.mode.frequency_hz - 1.0).min() < 0.02


def test_a_table_keeps_its_json_form(ambient):
    _, table = ambient
    content = to_json(table)
    assert to_json(from_json(ModeTable, content)) == content


def test_without_held_out_samples_a_mode_is_not_judged(ambient):
    estimates, table = ambient
    y = np.zeros((2200, 3))
    unjudged = mode_table(estimates, recording_of(None, y, RATE))
    assert {each.origin for each in unjudged.modes} == {"not judged"}
    assert len(unjudged.modes) == len(table.modes)


def test_smaller_orders_do_not_speak_against_a_mode_of_the_largest(ambient):
    estimates, _ = ambient
    models = [OrderModel.of(each.model.order, each.bic, each.model) for each in estimates]
    table = table_of_models(models, 12)
    own = [each for each in table.modes if each.order == 12]
    assert own
    assert {each.stable for each in own} <= {None, True}


def test_modes_of_the_largest_order_are_trusted_where_the_last_three_orders_have_them(ambient):
    """A larger order that was not tried may have other ones in their place."""
    estimates, _ = ambient
    models = [OrderModel.of(each.model.order, each.bic, each.model) for each in estimates]
    y = CLOSE.ambient_record(900, RATE, 0.2, np.random.default_rng(5))
    recording = recording_of(None, y, RATE)

    def trusted(some, chosen):
        table = table_of_models(some, chosen, lambda model: divided(model, recording, 0))
        return [each.frequency_hz for each in table.trusted]

    # The pair at 12 Hz is one mode of four states: 2, 4 and 6 states have the one at 5 Hz alone.
    assert len(trusted(models[:4], 6)) == 3
    assert len(trusted(models[:3], 6)) < 2
    assert trusted(models[2:5], 10) == pytest.approx(CLOSE.frequencies_hz, rel=0.02)


def test_a_pair_whose_shapes_are_mixed_is_stated_as_their_plane(ambient):
    """Frequencies and damping ratios of the pair stay trusted, its shapes are not."""
    estimates, _ = ambient
    y = CLOSE.ambient_record(800, RATE, 0.2, np.random.default_rng(4))
    models = [OrderModel.of(each.model.order, each.bic, each.model) for each in estimates]

    def changed(**of_pair):
        modes = [
            replace(mode, **of_pair) if mode.frequency_hz > 11.0 else mode
            for mode in models[2].modes
        ]
        mixed = [replace(each, modes=tuple(modes)) if each.order == 6 else each for each in models]
        recording = recording_of(None, y, RATE)
        return table_of_models(mixed, 6, lambda model: divided(model, recording, 0))

    table = changed(equal_poles_p=0.3)
    assert [each.shape_trusted for each in table.modes if each.trusted] == [True, False, False]
    rows = [k for k, each in enumerate(table.modes) if each.shape_doubt]
    assert [table.modes[k].pair for k in rows] == rows[::-1]
    # Forces of one colour at several places have about the same pole each.
    for p, is_colour in ((0.3, True), (0.0, False)):
        mode = replace(table.modes[rows[0]].mode, damping_ratio=0.05, equal_poles_p=p)
        reasons = doubts(replace(table.modes[rows[0]], mode=mode), RATE)
        assert any("colour of the force" in reason for reason in reasons) == is_colour
    csv = table.rows((), ("a", "b", "c"))
    assert csv["plane_with_mode"][3 * rows[0]] == str(rows[1] + 1)
    assert [changed(equal_poles_p=0.3, plane_assurance=0.7).modes[k].pair for k in rows] == [
        None
    ] * 2
    unknown = changed(shape_assurance=0.6)
    assert [unknown.modes[k].pair for k in rows] == [None, None]
    assert "0.60" in unknown.modes[rows[0]].shape_doubt


def two_modes(driven, noisy, spurious=0.0):
    """A mode at 8 Hz that the input drives, one at 20 Hz that the noise does, two outputs.

    ``spurious`` is what an estimate would have in the input's row of the second mode.
    """
    A = np.zeros((4, 4))
    for k, f in enumerate((8.0, 20.0)):
        pole = np.exp((-0.02 + 1j) * 2.0 * np.pi * f / RATE)
        A[2 * k : 2 * k + 2, 2 * k : 2 * k + 2] = [[pole.real, pole.imag], [-pole.imag, pole.real]]
    return StateSpaceModel(
        A=A,
        B=np.array([[driven], [0.3 * driven], [spurious], [0.5 * spurious]]),
        C=np.array([[1.0, 0.2, 0.8, 0.1], [0.5, -0.3, -1.0, 0.4]]),
        D=np.zeros((2, 1)),
        K=noisy * np.array([[0.0, 0.0], [0.0, 0.0], [0.3, -0.1], [0.1, -0.3]]),
        sampling_rate=RATE,
        level=np.zeros(2),
        noise_covariance=np.eye(2),
    )


def recorded(model, samples, seed):
    generator = np.random.default_rng([9, seed])
    u, e = generator.standard_normal((samples, 1)), generator.standard_normal((samples, 2))
    y, x = np.empty((samples, 2)), np.zeros(4)
    for t in range(samples):
        y[t] = model.C @ x + e[t]
        x = model.A @ x + model.B @ u[t] + model.K @ e[t]
    return u, y


def test_the_input_and_the_noise_each_have_their_mode():
    u, y = recorded(two_modes(1.0, 1.0), 2500, 1)
    orders = range(2, 11, 2)
    recording = Recording(u, y, RATE)
    estimates = list(estimates_of_orders(recording.between(0, 1700), orders, width=3))
    table = mode_table(estimates, recording, 1700)
    found = {round(each.mode.frequency_hz): each for each in table.modes if each.trusted}
    assert sorted(found) == [8, 20]
    assert found[8].origin == "input"
    assert found[20].origin == "noise"
    assert not found[20].reached


def test_the_tests_reject_at_their_level_what_is_not_there():
    """An estimate's chance input to a mode passes no more often than the level says."""
    truth, estimate = two_modes(1.0, 0.0), two_modes(1.0, 0.0, spurious=0.02)
    p_values = []
    for seed in range(200):
        u, y = recorded(truth, 400, seed)
        modes = estimate.modes()
        held_out = divided(estimate, Recording(u, y, RATE), 100)
        p_values.append([each[0].p_value for each in held_out_mode_tests(modes, held_out)])
    driven, not_driven = np.array(p_values).T
    assert (driven < 0.01).all()
    # At a level of 5 %, 200 records reject between 2 and 20 times but for one case in a thousand.
    assert 2 <= (not_driven < 0.05).sum() <= 20
