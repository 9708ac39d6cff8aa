"""Models whose coefficients move: known systems, exact derivatives, and their choice."""

from dataclasses import replace
from functools import partial
from types import SimpleNamespace

import numpy as np
import pandas as pd
import pytest
from numpy.polynomial.legendre import legvander
from scipy.optimize import approx_fprime

from evopem import (
    InputError,
    Orders,
    Recording,
    SearchSettings,
    estimate,
    estimate_varying,
    identify,
)
from evopem.automatic.varying import Moves, Varying, blocks, held_out_errors, what_moves, whole
from evopem.config.settings import VaryingSettings
from evopem.estimation.continuous import Fit
from evopem.estimation.varying import Scheduled, VaryingProblem, fit_varying
from evopem.estimation.varying_choice import choose_again, choose_varying, race, undersmoothed
from evopem.figures.moving import spectrograms
from evopem.files.json_form import from_json, load, to_json
from evopem.models.modes import Mode
from evopem.models.varying import (
    Basis,
    MovingMode,
    VaryingModel,
    all_free,
    delayed_inputs,
    filtered,
)
from evopem.report.results_text import moving_sentence
from evopem.report.verdict_file import VerdictFile
from evopem.signals.prepared_data import PreparedData, StretchOrigin, Transforms
from evopem.signals.recording import Segment
from evopem.validation.model_class import ModelClass, ResidualTest

RATE = 100.0
ZETA = 0.03


def frequency(times):
    """Natural frequency (Hz) that rises along a parabola."""
    return 10.0 + 4.0 * (times / times[-1]) ** 2


def denominators(frequencies):
    """Of a mode of damping ZETA, (N, 2)."""
    omega = 2.0 * np.pi * np.asarray(frequencies) / RATE
    radius = np.exp(-ZETA * omega)
    turned = omega * np.sqrt(1.0 - ZETA**2)
    return np.column_stack([-2.0 * radius * np.cos(turned), radius**2])


def moving(structure, samples=2000, seed=0, a=None, colour=0.6):
    """A recording of a mode that moves, of a structure with C = 1 + colour q^-1."""
    generator, times = np.random.default_rng(seed), np.arange(samples) / RATE
    u, e = generator.normal(size=(samples, 1)), 0.3 * generator.normal(size=samples)
    a = denominators(frequency(times)) if a is None else a
    bounds = np.array([0, samples])
    forced = delayed_inputs(Orders(na=2, nb=2, nk=1), u, bounds) @ [1.0, 0.5]
    coloured = e + colour * np.r_[0.0, e[:-1]]
    drives = {
        "ar": (e, 0.0),
        "arx": (forced + e, 0.0),
        "armax": (forced + coloured, 0.0),
        "oe": (forced, e + 0.7),
    }
    drive, added = drives[structure]
    y = filtered(drive[:, None], a, bounds)[:, 0] + added
    return Recording(u if structure != "ar" else None or u[:, :0], y, RATE)


ORDERS = {
    "ar": Orders(na=2),
    "arx": Orders(na=2, nb=2, nk=1),
    "armax": Orders(na=2, nb=2, nc=1, nk=1),
    "oe": Orders("oe", nb=2, nf=2, nk=1),
}


def in_segments(data):
    """The same samples but for a gap."""
    first, second = data.segments[0].between(0, 700), data.segments[0].between(750, data.samples)
    return data.with_segments([first, second])


@pytest.mark.parametrize("kind", ["legendre", "cosine", "spline"])
def test_a_basis_begins_with_a_constant_and_knows_its_range(kind):
    basis = Basis(kind, 6, -2.0, 3.0)
    s = np.linspace(-2.0, 3.0, 200)
    functions = basis.at(s)
    assert np.linalg.matrix_rank(functions) == 6
    np.testing.assert_allclose(functions[:, 0], 1.0)
    with pytest.raises(InputError, match="stay within -2 and 3"):
        basis.at([3.1])


def test_splines_make_every_cubic():
    s = np.linspace(0.0, 7.0, 50)
    functions, cubic = Basis("spline", 7, 0.0, 7.0).at(s), s**3 - 4.0 * s
    weights = np.linalg.lstsq(functions, cubic, None)[0]
    np.testing.assert_allclose(functions @ weights, cubic, atol=1e-9)


def test_an_autoregression_is_least_squares():
    data = moving("arx")
    fit = fit_varying(Scheduled.of(data), ORDERS["arx"], Basis("legendre", 3, 0.0, 19.99))
    y, u, functions = data.output, data.input, legvander(np.linspace(-1.0, 1.0, 2000), 2)
    past = [-y[1:-1], -y[:-2], u[1:-1], u[:-2], np.ones(1998)]
    columns = np.hstack([signal[:, None] * functions[2:] for signal in past])
    expected = np.linalg.lstsq(columns, y[2:], None)[0]
    np.testing.assert_allclose(fit.model.weights.ravel(), expected, rtol=1e-9, atol=1e-12)
    np.testing.assert_allclose(fit.errors[2:], y[2:] - columns @ expected, atol=1e-9)


@pytest.mark.parametrize("apart", [1e-3, 1e-7])
def test_columns_that_are_nearly_alike_lose_no_digits(apart):
    """By a Gram matrix, or by QR where it loses too many."""
    y, first, second, third = np.random.default_rng(4).normal(size=(4, 500))
    columns = np.column_stack([first, second, first + apart * third, np.ones(500)])
    fit, expected = Fit.of(columns, y, np.ones(500)), np.linalg.lstsq(columns, y, None)[0]
    np.testing.assert_allclose(fit.errors, y - columns @ expected, atol=1e-8)
    np.testing.assert_allclose(fit.across(columns), 0.0, atol=1e-6)


@pytest.mark.parametrize("structure", ["armax", "oe"])
def test_gradients_are_those_of_finite_differences(structure):
    scheduled = Scheduled.of(in_segments(moving(structure, 1500)))
    basis = scheduled.basis("cosine", 3)
    problem = VaryingProblem(
        scheduled, ORDERS[structure], basis, all_free(ORDERS[structure], basis)
    )
    point = 0.8 * problem.random(1, np.random.default_rng(3))[0]
    fit = problem.projection(point)
    gradient = 2.0 * problem.jacobian(point, fit).T @ fit.errors
    numeric = approx_fprime(point, lambda x: np.sum(problem.projection(x).errors ** 2), 1e-7)
    np.testing.assert_allclose(gradient, numeric, rtol=1e-4, atol=1e-5 * np.abs(numeric).max())


def test_without_motion_output_error_is_that_of_the_constant_search():
    a = np.tile(denominators([12.0]), (800, 1))
    data = moving("oe", 800, a=a)
    settings = SearchSettings(objective="quadratic", evaluations=2000)
    constant = estimate(data, orders=ORDERS["oe"], structure="oe", level=True, settings=settings)
    scheduled = Scheduled.of(data)
    model = fit_varying(scheduled, ORDERS["oe"], scheduled.basis("legendre", 1)).model
    (mode,), (expected,) = model.frozen(1.0).modes(), constant.model.modes()
    # The first samples, whose past inputs are not measured, count in one of them only.
    assert mode.frequency_hz == pytest.approx(expected.frequency_hz, abs=0.1 * mode.frequency_se_hz)
    assert mode.damping_ratio == pytest.approx(expected.damping_ratio, abs=0.1 * mode.damping_se)
    assert mode.frequency_se_hz == pytest.approx(expected.frequency_se_hz, rel=0.05)


@pytest.mark.parametrize("structure", ["ar", "arx", "armax", "oe"])
def test_frozen_modes_are_those_of_the_system(structure):
    data = moving(structure)
    scheduled = Scheduled.of(data)
    fit = fit_varying(scheduled, ORDERS[structure], scheduled.basis("legendre", 5))
    moments = np.linspace(0.0, data.times[-1], 9)
    path = fit.model.modes(moments)[0].modes
    truth = np.interp(moments, data.times, frequency(data.times))
    deviations = [
        (m.frequency_hz - f) / m.frequency_se_hz for m, f in zip(path, truth, strict=True)
    ]
    dampings = [(m.damping_ratio - ZETA) / m.damping_se for m in path]
    assert np.abs([deviations, dampings]).max() < 3.5
    assert max(m.frequency_se_hz for m in path) < 0.3
    assert fit.model.radii().max() < 1.0


@pytest.mark.parametrize("structure", ["arx", "armax", "oe"])
def test_predictions_are_those_of_the_recursion(structure):
    data = moving(structure, 400)
    scheduled = Scheduled.of(data)
    model = fit_varying(scheduled, ORDERS[structure], scheduled.basis("legendre", 2)).model
    theta, rows = model.coefficients(data.times), model.rows
    a, b, level = theta[:, rows["a"]], theta[:, rows["b"]], theta[:, -1]
    c = a if structure == "oe" else theta[:, rows["c"]]
    y, u = data.output - (level if structure == "oe" else 0.0), data.input
    base = 0.0 if structure == "oe" else level
    e = np.zeros(400)
    for t in range(2, 400):
        known = (
            a[t] @ y[[t - 1, t - 2]] - b[t] @ u[[t - 1, t - 2]] - (base[t] if np.ndim(base) else 0)
        )
        e[t] = y[t] + known - c[t] @ e[t - 1 - np.arange(c.shape[1])]
    now, known = y.copy(), e.copy()
    known[301:] = 0.0
    for t in range(301, 304):
        b_u = b[t] @ u[[t - 1, t - 2]] + (base[t] if np.ndim(base) else 0)
        now[t] = -a[t] @ now[[t - 1, t - 2]] + b_u + c[t] @ known[t - 1 - np.arange(c.shape[1])]
    ahead = now[303] + (level[303] if structure == "oe" else 0.0)
    predicted = model.predict(data.inputs, data.output, data.times, 3)
    assert predicted[303] == pytest.approx(ahead, rel=1e-9)
    assert np.isnan(predicted[:4]).all()
    assert np.isfinite(predicted[4:]).all()


def test_a_simulation_of_the_true_model_has_no_error():
    times = np.arange(300) / RATE
    weights = np.array([[-1.4, 0.2], [0.9, 0.0], [1.0, 0.0], [0.5, 0.3], [0.1, 0.0]])
    basis = Basis("legendre", 2, 0.0, times[-1])
    model = VaryingModel(ORDERS["arx"], basis, weights, np.array([0.0, 0.0]), RATE)
    u, y = np.random.default_rng(1).normal(size=300), np.zeros(300)
    for t in range(300):
        past = [
            [y[t - k] if t >= k else 0.0 for k in (1, 2)],
            [u[t - k] if t >= k else 0.0 for k in (1, 2)],
        ]
        theta = weights @ [1.0, 2.0 * t / 299 - 1.0]
        y[t] = -theta[:2] @ past[0] + theta[2:4] @ past[1] + theta[4]
    np.testing.assert_allclose(model.simulate(u, times), y, atol=1e-9)


def test_variance_that_moves_is_estimated():
    generator, times = np.random.default_rng(5), np.arange(4000) / RATE
    deviation = np.exp(times / times[-1])
    y = filtered(
        (deviation * generator.normal(size=4000))[:, None],
        np.full((4000, 1), -0.8),
        np.array([0, 4000]),
    )
    scheduled = Scheduled.of(Recording(np.zeros((4000, 0)), y, RATE))
    model = fit_varying(scheduled, Orders(na=1), scheduled.basis("legendre", 3)).model
    ratio = model.noise_variance(times[::400]) / deviation[::400] ** 2
    assert np.abs(np.log(ratio)).max() < 0.25


def test_a_model_comes_back_from_its_json_form():
    scheduled = Scheduled.of(moving("armax", 500))
    model = fit_varying(scheduled, ORDERS["armax"], scheduled.basis("spline", 5)).model
    again = from_json(VaryingModel, to_json(model))
    assert to_json(again) == to_json(model)
    (mode,), (expected,) = again.frozen(2.0).modes(), model.frozen(2.0).modes()
    assert (mode.frequency_hz, mode.damping_se) == (expected.frequency_hz, expected.damping_se)


def test_a_condition_schedules_recordings():
    """Three recordings at constant conditions; the mode follows them."""
    conditions, segments = [20.0, 30.0, 50.0], []
    for number, value in enumerate(conditions):
        a = np.tile(denominators([10.0 + 0.1 * value]), (1000, 1))
        part = moving("arx", 1000, seed=number, a=a)
        segments.append(Segment(part.inputs, part.outputs, number))
    data = moving("arx", 1000).with_segments(segments)
    scheduled = Scheduled.of(data, np.repeat(conditions, 1000))
    model = fit_varying(scheduled, ORDERS["arx"], scheduled.basis("legendre", 2)).model
    for value in (20.0, 40.0, 50.0):
        (mode,) = model.frozen(value).modes()
        assert abs(mode.frequency_hz - 10.0 - 0.1 * value) < 4.0 * mode.frequency_se_hz + 0.02
    with pytest.raises(InputError, match="stay within 20 and 50"):
        model.frozen(51.0)


@pytest.mark.parametrize("structure", ["arx", "armax", "oe"])
def test_each_of_several_inputs_has_coefficients_of_its_own(structure):
    samples, bounds = 1500, np.array([0, 1500])
    generator, times = np.random.default_rng(8), np.arange(samples) / RATE
    u, e = generator.normal(size=(samples, 2)), 0.3 * generator.normal(size=samples)
    gains, past = np.column_stack([np.ones(samples), 1.0 + times / times[-1]]), np.zeros((1, 2))
    forced = np.sum(gains * np.vstack([past, u[:-1]]), axis=1)
    noise = {"arx": e, "armax": e + 0.6 * np.r_[0.0, e[:-1]], "oe": 0.0}[structure]
    a = denominators(frequency(times))
    y = filtered((forced + noise)[:, None], a, bounds)[:, 0] + e * (structure == "oe")
    given = {"nc": 1} if structure == "armax" else {"nf": (2, 2)} if structure == "oe" else {}
    structured = ("oe",) if structure == "oe" else ()
    poles = {} if structure == "oe" else {"na": 2}
    orders = Orders(*structured, nb=(1, 1), nk=(1, 1), **poles, **given)
    scheduled = Scheduled.of(Recording(u, y, RATE))
    model = fit_varying(scheduled, orders, scheduled.basis("legendre", 4)).model
    for place in (100, 750, 1400):
        frozen = model.frozen(times[place])
        (mode,) = frozen.modes()
        assert abs(mode.frequency_hz - frequency(times)[place]) < 4.0 * mode.frequency_se_hz
        gain = np.abs(frozen.frequency_response(np.array([5.0])))[0, 0]
        z = np.exp(-2j * np.pi * 5.0 / RATE)
        truth = gains[place] / abs(1.0 + a[place] @ [z, z**2])
        np.testing.assert_allclose(gain, truth, rtol=0.15)


@pytest.mark.parametrize("structure", ["ar", "arx", "armax", "oe"])
def test_the_structure_is_chosen(structure):
    scheduled = Scheduled.of(moving(structure, 1200))
    chosen = choose_varying(scheduled, race(scheduled, 3, () if structure == "ar" else (1,)))
    assert chosen.model.orders.structure == ("arx" if structure == "ar" else structure)
    assert denominator_size(chosen.model) == 2
    assert np.any(chosen.free[:2, 1:])


def denominator_size(model):
    return model.rows["a"].stop


def test_what_stays_has_no_moving_terms():
    a = np.tile(denominators([12.0]), (2000, 1))
    scheduled = Scheduled.of(moving("arx", a=a))
    chosen = choose_varying(scheduled, race(scheduled, 3, (1,)))
    assert not np.any(chosen.free[:, 1:])


def test_held_out_samples_are_not_fitted():
    scheduled = Scheduled.of(moving("armax", 800))
    weights = np.ones(800)
    weights[300:400] = 0.0
    changed = scheduled.data.output.copy()
    held = Scheduled(scheduled.data, scheduled.schedule, weights)
    model = fit_varying(held, ORDERS["arx"], held.basis("legendre", 2)).model
    changed[305:395] += 5.0
    other_data = Recording(scheduled.data.inputs, changed, RATE)
    other = Scheduled(other_data, scheduled.schedule, np.where(np.arange(800) < 400, weights, 1.0))
    again = fit_varying(other, ORDERS["arx"], held.basis("legendre", 2)).model
    np.testing.assert_allclose(again.weights, model.weights, rtol=1e-9, atol=1e-12)


@pytest.fixture(scope="module")
def chirp():
    """Results of a chirping resonance with an input, two of the structures searched."""
    return identify(
        *(moving("arx", 1200).inputs, moving("arx", 1200).output, RATE),
        show_progress=False,
        structure="arx",
    )


def test_a_chirping_resonance_is_reported(chirp, undrawn, tmp_path):
    moves = chirp.varying.moves
    (mode,) = moves.modes
    assert moves.is_better
    assert moves.error_percent < moves.constant_error_percent
    assert mode.moves
    for end, truth in zip((mode.modes[0], mode.modes[-1]), (10.0, 14.0), strict=True):
        assert abs(end.frequency_hz - truth) < 4.0 * end.frequency_se_hz
    listed = load(VerdictFile, chirp.files.verdict).moves
    assert (listed.schedule, listed.is_better, listed.error_percent) == (
        *("time", True),
        moves.error_percent,
    )
    assert listed.modes[0].from_hz == mode.modes[0].frequency_hz
    assert listed.modes[0].to_se_hz == mode.modes[-1].frequency_se_hz
    assert listed.modes[0].moves
    assert "The machine changes: mode 1 moves from" in str(chirp)
    page = chirp.report(tmp_path / "report.html").read_text(encoding="utf-8")
    for words in ("The machine changes: mode 1 moves from", "Modes over time", "Gain over time"):
        assert words in page
    assert "validation samples are a stretch of their own" in page
    table = pd.read_csv(chirp.files.varying_modes)
    truth = np.interp(table["time_s"], np.arange(1200) / RATE, frequency(np.arange(1200) / RATE))
    covered = (table["frequency_lower"] < truth) & (truth < table["frequency_upper"])
    assert covered.mean() > 0.7
    percent = 100.0 * ZETA
    covered = (table["damping_lower"] < percent) & (percent < table["damping_upper"])
    assert covered.mean() > 0.7


@pytest.mark.parametrize(
    ("recording", "start", "source", "samples", "drawn"),
    [(0, 4.0, "cut", 600, [6.0]), (0, 9.0, "gap", 600, [4.0, 11.0]), (1, 0.0, "file", 400, [4.0])],
)
def test_time_goes_on_within_one_recording_alone(recording, start, source, samples, drawn):
    """Samples of another file have none of its time; spectrograms are of all that have."""
    parts = moving("arx", 400), moving("arx", 200)
    origins = [
        StretchOrigin(number, 0, first, part.samples, (0.0,), (0.0,))
        for number, first, part in zip((0, recording), (0.0, start), parts, strict=True)
    ]
    given = Transforms(RATE, None, (origins[0],), (origins[1],), source)
    scheduled = whole(PreparedData(*parts, given), VaryingSettings())
    assert scheduled.data.samples == len(scheduled.schedule) == samples
    ends = [times[-1] for times, *_ in spectrograms(scheduled)]
    np.testing.assert_allclose(ends, drawn, atol=0.1)


def test_no_moving_model_is_tried_where_nonlinearity_explains_the_change():
    failed = ResidualTest(1e-6, 0.05)
    tests = ModelClass(failed, failed, ResidualTest(0.5, 0.0), follows="constant")
    record = SimpleNamespace(output_names=("y",))
    prepared = SimpleNamespace(transforms=SimpleNamespace(several_recordings=False))
    found = what_moves(prepared, record, VaryingSettings(), tests)
    assert found.reason.startswith("nonlinearity or feedback explains more")


def test_a_constant_system_has_no_moving_model():
    data = moving("arx", 1200, a=np.tile(denominators([12.0]), (1200, 1)))
    constant = identify(data.inputs, data.output, RATE, show_progress=False, structure="arx")
    assert constant.varying.reason == "the response does not change with time"
    assert constant.varying.model is None
    assert "machine changes" not in str(constant)


def test_several_outputs_have_no_moving_model():
    data = moving("arx", 400)
    outputs = np.column_stack([data.output, data.output[::-1]])
    with pytest.raises(InputError, match="varying: there are several outputs"):
        identify(data.inputs, outputs, RATE, show_progress=False, varying={"dimension": 3})
    with pytest.raises(InputError, match="there are several outputs"):
        estimate_varying(data.inputs, outputs, RATE)


@pytest.mark.parametrize("structure", ["arx", "oe"])
def test_a_moving_model_is_estimated_in_one_call(structure, tmp_path):
    data = moving(structure, 1000)
    found = estimate_varying(data, orders=ORDERS[structure], basis="legendre", dimension=4)
    (mode,) = found.moves.modes
    truth = np.interp(mode.values, data.times, frequency(data.times))
    assert np.abs([m.frequency_hz for m in mode.modes] - truth).max() < 0.6
    assert found.moves.is_better
    assert repr(found).startswith("The machine changes: mode 1 moves from")
    assert found.modes["frequency_hz"].tolist() == [m.frequency_hz for m in mode.modes]
    first, _ = found.plot_modes()
    assert first.get_ylabel() == "Natural frequency (Hz)"
    found.save(tmp_path / "moving.json")
    again = load(Varying, tmp_path / "moving.json")
    simulated = found.model.simulate(data.inputs, data.times)
    np.testing.assert_array_equal(again.model.simulate(data.inputs, data.times), simulated)


def test_a_moving_model_is_chosen_along_a_condition_of_each_recording():
    found = estimate_varying(
        pooled("arx").data,
        schedule=TEMPERATURES,
        condition="temperature",
        orders=ORDERS["arx"],
    )
    assert found.moves.schedule == found.model.schedule == "temperature"
    assert found.modes["condition"].max() == 30.0


def test_a_mode_moves_by_more_than_the_error_of_two_correlated_moments():
    def path(last_hz):
        modes = Mode(10.0, 0.02, 0.9 + 0.1j, 0.1, 0.002), Mode(last_hz, 0.02, 0.9 + 0.1j, 0.1, 0.0)
        return MovingMode((0.0, 1.0), modes)

    moves = Moves("ARX(2,2,1)", 3.0, 4.0, 5.0, True, True, (path(10.35),))
    assert not path(10.35).moves
    assert moving_sentence(moves).startswith("The machine changes, though no mode by more than")
    assert "move, samples held out all along the recording are predicted" in moving_sentence(moves)
    moved = replace(moves, modes=(path(10.45),))
    assert moving_sentence(moved).startswith(
        "The machine changes: mode 1 moves from 10.00 ± 0.10 to 10.45 ± 0.10 Hz"
    )
    unstable = moving_sentence(replace(moved, is_stable=False))
    assert unstable.endswith(" At some moments its frozen poles are unstable.")
    nonlinear = moving_sentence(replace(moved, is_nonlinear=True))
    assert nonlinear.startswith(
        "The machine may be nonlinear: beside powers it shows no change. With"
    )


def test_a_condition_is_followed_within_one_recording():
    """There are no recordings to hold out: blocks of samples are, and the sentence says so."""
    load = 0.5 * (1.0 + np.sin(4.0 * np.pi * np.linspace(0.0, 1.0, 1500)))
    data = moving("ar", 1500, a=denominators(10.0 + 4.0 * load))
    given = {"orders": ORDERS["ar"], "basis": "legendre", "dimension": 3}
    found = estimate_varying(data, schedule=load, condition="load", **given)
    for value in (0.05, 0.5, 0.95):
        (mode,) = found.model.frozen(value).modes()
        assert abs(mode.frequency_hz - 10.0 - 4.0 * value) < 4.0 * mode.frequency_se_hz
    assert str(found).startswith("The machine changes with load: mode 1 moves from")
    assert "held-out samples are predicted" in repr(found)


@pytest.mark.parametrize(
    ("given", "sentence"),
    [
        ({"schedule": np.zeros(7)}, r"has the shape \(7,\)"),
        ({"schedule": np.zeros(400)}, "does not vary"),
        ({"orders": Orders("bj", nb=2, nf=2, nc=1, nd=1, nk=1)}, "cannot move; give those of AR"),
        ({"orders": Orders(na=2)}, "output error with 1 inputs"),
    ],
)
def test_what_cannot_move_is_refused(given, sentence):
    with pytest.raises(InputError, match=sentence):
        estimate_varying(moving("arx", 400), **given)


def test_each_fold_is_held_out_of_the_choice():
    scheduled, seen = Scheduled.of(moving("arx", 800)), []
    raced = race(scheduled, 2, (1,), ("legendre",), (1, 2, 3))

    def choose(others):
        seen.append(others.weights)
        return choose_again(others, raced)

    errors = held_out_errors(scheduled, choose)
    assert np.isfinite(errors[2:]).all()
    assert sum(seen).tolist() == [4.0] * 800
    weights = (np.arange(800) // 20 % 5 != 0).astype(float)  # every fifth of 40 blocks is held out
    of_first = choose_again(Scheduled(scheduled.data, scheduled.schedule, weights), raced)
    held = np.flatnonzero(weights == 0.0)[2:]
    np.testing.assert_allclose(errors[held], of_first.errors[held])
    assert np.nanmean(errors**2) > np.nanmean(raced[0].errors ** 2)


def test_bands_contain_what_the_criterion_leaves_out():
    covered, truth = {False: [], True: []}, 12.0 * (1.0 + 0.3 * np.linspace(-0.5, 0.5, 1000))
    for seed in range(12):
        data = moving("arx", 1000, seed=seed, a=denominators(truth))
        scheduled = Scheduled.of(data)
        fits = [
            fit_varying(scheduled, ORDERS["arx"], scheduled.basis("legendre", n)) for n in (2, 3)
        ]
        chosen = min(fits, key=lambda fit: fit.bic)
        for is_under, fit in ((False, chosen), (True, undersmoothed(scheduled, chosen))):
            for place in range(0, 1000, 111):
                (mode,) = fit.model.frozen(data.times[place]).modes()
                deviation = abs(mode.frequency_hz - truth[place])
                covered[is_under].append(deviation < 1.96 * mode.frequency_se_hz)
    assert np.mean(covered[False]) < 0.8
    assert np.mean(covered[True]) > 0.88


TEMPERATURES = (5.0, 30.0, 12.0, 18.0, 24.0, 0.0)


def denominators_at(temperatures):
    """Parabolas of the temperature, through modes of 12, 11 and 9.6 Hz at 0, 15 and 30."""
    ends = np.linalg.inv(np.vander([0.0, 15.0, 30.0])) @ denominators([12.0, 11.0, 9.6])
    return np.vander(np.atleast_1d(temperatures), 3) @ ends


def warm(temperatures):
    """Natural frequencies (Hz) at some temperatures."""
    poles = [np.roots([1.0, *a])[0] for a in denominators_at(temperatures)]
    return np.abs(np.log(poles)) * RATE / (2.0 * np.pi)


def recorded_at(structure, temperatures=TEMPERATURES, samples=400, seed=3):
    """Recordings of one machine, each at a temperature of its own."""
    return [
        moving(structure, samples, seed + k, a=np.tile(denominators_at(t), (samples, 1)))
        for k, t in enumerate(temperatures)
    ]


def pooled(structure, seed=3):
    """All of them as segments of one recording, by their temperature."""
    parts = recorded_at(structure, seed=seed)
    segments = [Segment(part.inputs, part.outputs, k) for k, part in enumerate(parts)]
    return Scheduled.of(parts[0].with_segments(segments), np.repeat(TEMPERATURES, 400))


@pytest.mark.parametrize(("structure", "count"), [("arx", 12), ("armax", 2), ("oe", 2)])
def test_modes_along_a_condition_are_covered_also_where_nothing_was_recorded(structure, count):
    deviations, at = [], np.array([2.5, 9.0, 15.0, 27.0])
    for seed in range(count):
        scheduled = pooled(structure, 100 * seed)
        basis = scheduled.basis("legendre", 3)
        model = fit_varying(scheduled, ORDERS[structure], basis).model
        path = model.modes(at)[0].modes
        errors = np.array([mode.frequency_se_hz for mode in path])
        assert errors.max() < 0.1
        deviations.append((np.array([mode.frequency_hz for mode in path]) - warm(at)) / errors)
        with pytest.raises(InputError, match="stay within 0 and 30"):
            model.frozen(30.5)
    assert np.abs(deviations).max() < 3.5
    assert np.mean(np.abs(deviations) < 1.96) > 0.8


def test_modes_are_covered_between_conditions_that_leave_a_wide_gap():
    """Cosines fit the recordings as well as polynomials, and are far off between them."""
    temperatures, at = (8.4, 11.3, 11.6, 15.3, 15.5, 29.5), np.linspace(8.4, 29.5, 11)
    for seed in (50, 60):
        parts = recorded_at("arx", temperatures, 300, seed)
        segments = [Segment(part.inputs, part.outputs, k) for k, part in enumerate(parts)]
        data = parts[0].with_segments(segments)
        given = {"schedule": temperatures, "condition": "temperature", "orders": ORDERS["arx"]}
        path = estimate_varying(data, **given).model.modes(at)[0].modes
        errors = np.array([mode.frequency_se_hz for mode in path])
        assert np.abs(([m.frequency_hz for m in path] - warm(at)) / errors).max() < 3.5


@pytest.fixture(scope="module")
def machine():
    """Results of several recordings of one machine, each at a temperature of its own."""
    parts = recorded_at("arx")
    signals = [part.inputs[:, 0] for part in parts], [part.output for part in parts]
    varying = {"condition": "temperature", "values": list(TEMPERATURES)}
    return identify(*signals, RATE, show_progress=False, structure="arx", varying=varying)


def test_one_model_of_recordings_at_several_temperatures_is_reported(machine, undrawn, tmp_path):
    found = machine.varying
    assert found.model.schedule == found.moves.schedule == "temperature"
    assert found.moves.is_better
    assert found.moves.error_percent < found.moves.constant_error_percent
    for temperature in (0.0, 15.0, 30.0):
        (mode,) = found.model.frozen(temperature).modes()
        assert abs(mode.frequency_hz - warm(temperature)[0]) < 4.0 * mode.frequency_se_hz
    with pytest.raises(InputError, match="stay within 0 and 30"):
        found.model.frozen(-1.0)
    assert "The machine changes with temperature: mode 1 moves from 1" in str(machine)
    page = machine.report(tmp_path / "report.html").read_text(encoding="utf-8")
    for words in ("Modes over temperature", "Gain over temperature", "all but those at the ends"):
        assert words in page
    assert "Spectrogram" not in page
    table = pd.read_csv(machine.files.varying_modes)
    truth = warm(table["condition"])
    covered = (table["frequency_lower"] < truth) & (truth < table["frequency_upper"])
    assert covered.mean() > 0.7


def test_recordings_are_held_out_whole_and_not_at_the_ends_of_the_condition():
    scheduled = pooled("arx")
    of_block = blocks(scheduled)
    assert sorted(set(scheduled.schedule[of_block < 0])) == [0.0, 30.0]
    basis = scheduled.basis("legendre", 3)
    errors = held_out_errors(scheduled, partial(fit_varying, orders=ORDERS["arx"], basis=basis))
    cold = scheduled.schedule == 5.0
    weights = (of_block != of_block[cold][0]).astype(float)
    others = Scheduled(scheduled.data, scheduled.schedule, weights)
    alone = fit_varying(others, ORDERS["arx"], basis)
    np.testing.assert_allclose(errors[cold][133:], alone.errors[cold][133:])
    assert np.isnan(errors[cold][:133]).all()
    assert np.isnan(errors[scheduled.schedule == 30.0]).all()


def test_output_error_predicts_recordings_that_are_held_out():
    """Of their states before the first sample nothing is known: they are taken for at rest."""
    scheduled, basis = pooled("oe"), pooled("oe").basis("legendre", 2)
    problem = VaryingProblem(scheduled, ORDERS["oe"], basis, all_free(ORDERS["oe"], basis))
    start = problem.start()
    fit = partial(fit_varying, orders=ORDERS["oe"], basis=basis, starts=[start])
    errors = held_out_errors(scheduled, fit)
    known = np.isfinite(errors)
    assert known.sum() == 4 * 267
    assert np.sqrt(np.mean(errors[known] ** 2)) < 0.5 * np.std(scheduled.data.output)


@pytest.mark.parametrize(
    ("varying", "sentence"),
    [
        ({"condition": "load", "values": [1, 2]}, "there are 2 values of load and 4 recordings"),
        ({"condition": "load"}, "there are 0 values of load and 4 recordings"),
        ({"condition": "load", "values": [1, 2, 2, 3]}, "takes 3 different values, and 4 are"),
        ({"values": [1, 2, 3, 4]}, "values stand without a condition; name it"),
        ({"condition": "load", "values": [1, 2, 3, 4], "dimension": 3}, "give 2 at most"),
        ({"condition": "load", "values": [1, 2, 3, "x"]}, "x cannot be used; give a number"),
        ({"dimension": 3}, "there are several recordings, and coefficients move with the time"),
    ],
)
def test_conditions_that_no_model_can_follow_are_refused(varying, sentence):
    parts = recorded_at("arx", (1.0, 2.0, 3.0, 4.0), 300)
    signals = [part.inputs[:, 0] for part in parts], [part.output for part in parts]
    with pytest.raises(InputError) as raised:
        identify(*signals, RATE, show_progress=False, structure="arx", varying=varying)
    assert sentence in str(raised.value)


def test_coefficients_of_the_poles_move_together_in_the_bands():
    """One that stays as it is makes the damping move by more than its standard error."""
    scheduled, basis = pooled("arx"), pooled("arx").basis("legendre", 3)
    free = all_free(ORDERS["arx"], basis)
    free[1:, 1:] = False
    fit = undersmoothed(scheduled, fit_varying(scheduled, ORDERS["arx"], basis, free))
    assert fit.free.sum(axis=1).tolist() == [4, 4, 1, 1, 1]
    for temperature in (0.0, 15.0, 30.0):
        (mode,) = fit.model.frozen(temperature).modes()
        (truth,) = np.roots([1.0, *denominators_at(temperature)[0]])[:1]
        s = np.log(truth)
        assert abs(mode.damping_ratio + s.real / abs(s)) < 3.0 * mode.damping_se
