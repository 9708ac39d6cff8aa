"""Parts of the simulation error of simulated systems whose distortion is known from its definition.

A larger number of records, and of systems: ``benchmarks/nonlinear_distortion.py``.
"""

import sys
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy.signal import lfilter

from evopem.models.polynomial import PolynomialModel
from evopem.report.results_text import error_parts as sentences_of
from evopem.signals.best_linear_approximation import realisations_of
from evopem.signals.recording import Recording, concatenated
from evopem.validation.distortion import Distortion, distortion_of, floors_of
from evopem.validation.error_parts import ErrorParts, Part
from evopem.validation.responses import divided, stretches_of

sys.path.insert(0, str(Path(__file__).parents[2] / "benchmarks"))

from nonlinear_distortion import (
    ODD,
    PERIOD,
    A,
    B,
    backlash,
    best_gain,
    coefficients,
    hammerstein,
    linear,
    multisine,
    wiener,
    with_gaps,
)

RECORDS = 12


def error_parts(distortion, floors=()):
    judged = SimpleNamespace(distortion=distortion, floors=floors, prediction_error_percent=1.0)
    return sentences_of(judged)


def spaced(text):
    return text.replace("\u202f", " ")


def record(system, lines, generator, periods=2, noise=0.02):
    """A recording in steady state, and its output without noise."""
    u = np.tile(multisine(generator, lines), periods + 4)
    y = system(u)
    y -= np.mean(y[-PERIOD:])
    v = lfilter([1.0], [1.0, -0.8], generator.standard_normal(len(u)))
    kept = slice(-PERIOD * periods - PERIOD // 2, None)
    return Recording(u[kept], (y + noise * np.std(y) * v / np.std(v))[kept], 1.0), y[kept]


def judged(recordings, gain=1.0):
    """What is said with a model of the linear part."""
    model = PolynomialModel(A=[1.0], B=[gain * B[1:]], F=[A], nk=[1])
    stretches = stretches_of(model, concatenated(recordings))
    return distortion_of(stretches, (), False)


def known_distortion(recording, clean, lines, gain):
    """What the best linear approximation leaves of an output, percent of its deviation."""
    left = coefficients(clean)
    left[lines] -= gain * coefficients(recording.input)[lines]
    power = np.sum(2.0 * np.abs(left[1:]) ** 2)
    return power / np.var(recording.output)


def inside(part, truth):
    return part.low <= truth <= part.high


@pytest.mark.parametrize("system", [wiener, hammerstein, backlash])
@pytest.mark.parametrize("kind", ["lines left out", "realisations"])
def test_distortion_is_the_error_of_the_best_linear_approximation(system, kind):
    by_lines = kind == "lines left out"
    lines = with_gaps(ODD, np.random.default_rng(1)) if by_lines else np.arange(3, 181)
    gain, hits = best_gain(system, lines, 150), []
    for seed in range(RECORDS):
        generator = np.random.default_rng([seed, by_lines])
        made = [record(system, lines, generator) for _ in range(1 if by_lines else 4)]
        found = judged([each for each, _ in made], gain=float(np.abs(gain[0] / best(lines)[0])))
        truth = np.mean([known_distortion(*each, lines, gain) for each in made])
        (parts,) = found.outputs
        assert found.separated
        assert found.shown
        assert parts.distortion.percent == pytest.approx(100.0 * np.sqrt(truth), rel=0.35)
        hits.append((inside(parts.distortion, 100.0 * np.sqrt(truth)), inside(parts.noise, 2.0)))
        squares = sum(each.percent**2 for each in (parts.noise, parts.distortion, parts.rest))
        assert squares == pytest.approx(parts.error_percent**2)
    # Of 12 intervals of 95 % three or more miss in 2 % of all cases.
    assert np.sum(hits, axis=0).min() >= RECORDS - 2


def test_realisations_in_one_recording_are_told_apart():
    """Each has three periods of a step of its own, the first of which holds a transient."""
    lines, hits = np.arange(3, 181), []
    gain = best_gain(hammerstein, lines, 150)
    for seed in range(RECORDS):
        generator = np.random.default_rng([seed, 9])
        u = np.concatenate([np.tile(multisine(generator, lines), 3) for _ in range(5)])
        clean = hammerstein(u)
        clean -= clean.mean()
        v = lfilter([1.0], [1.0, -0.8], generator.standard_normal(len(u)))
        made = Recording(u, clean + 0.02 * np.std(clean) * v / np.std(v), 1.0)
        found = judged(
            [made.between(PERIOD, made.samples)], float(np.abs(gain[0] / best(lines)[0]))
        )
        assert (found.periods, found.realisations) == (2, 5)
        ends = [slice(k * PERIOD, (k + 1) * PERIOD) for k in (2, 5, 8, 11, 14)]
        parts = [made.between(at.start, at.stop) for at in ends]
        truth = np.mean(
            [known_distortion(a, clean[at], lines, gain) for a, at in zip(parts, ends, strict=True)]
        )
        (split,) = found.outputs
        assert split.distortion.percent == pytest.approx(100.0 * np.sqrt(truth), rel=0.2)
        hits.append((inside(split.distortion, 100.0 * np.sqrt(truth)), inside(split.noise, 2.0)))
    # Of 12 intervals of 95 % three or more miss in 2 % of all cases.
    assert np.sum(hits, axis=0).min() >= RECORDS - 2


def test_of_one_realisation_for_validation_those_for_estimation_tell():
    generator = np.random.default_rng(12)
    made = [record(hammerstein, np.arange(3, 181), generator)[0] for _ in range(4)]
    model = PolynomialModel(A=[1.0], B=[B[1:]], F=[A], nk=[1])
    last, others = (stretches_of(model, concatenated(x)) for x in (made[3:], made[:3]))
    found = distortion_of(last, others, False)
    assert (found.on, found.realisations, found.separated) == ("estimation", 3, True)
    assert distortion_of(others, last, False).on == "validation"
    assert distortion_of(last, last, False).on == "validation"


def best(lines):
    z = np.exp(-2j * np.pi * lines / PERIOD)
    return np.polyval(B[::-1], z) / np.polyval(A[::-1], z)


def test_noise_of_a_linear_system_is_no_distortion():
    lines, p_values = with_gaps(ODD, np.random.default_rng(1)), []
    for seed in range(60):
        found = judged([record(linear, lines, np.random.default_rng(seed))[0]], gain=1.05)
        (parts,) = found.outputs
        p_values.append(found.p_value)
        assert parts.distortion.percent < parts.noise.percent
        assert parts.rest.low <= 5.0 <= parts.rest.high * 1.05
    # Of 60 at 1 % five or more in 0.03 % of all cases.
    assert np.sum(np.array(p_values) < 0.01) < 5


def test_a_little_input_at_lines_left_out_is_no_distortion_of_a_wrong_model():
    lines, shown = with_gaps(ODD, np.random.default_rng(1)), 0
    for seed in range(20):
        generator = np.random.default_rng(seed)
        everywhere = 0.05 * multisine(generator, np.arange(1, PERIOD // 2))
        u = np.tile(multisine(generator, lines) + everywhere, 7)
        y = linear(u) + 0.005 * generator.standard_normal(len(u))
        shown += judged([Recording(u[-3 * PERIOD :], y[-3 * PERIOD :], 1.0)], gain=0.6).shown
    assert shown <= 1


def test_noise_of_a_measured_input_and_drift_are_no_distortion():
    lines, shown = with_gaps(np.arange(3, 181), np.random.default_rng(2)), 0
    for seed in range(20):
        generator = np.random.default_rng(seed)
        u = np.tile(multisine(generator, lines), 8)
        drift = np.cumsum(generator.standard_normal(len(u)))
        y = linear(u) + 0.05 * drift / np.std(drift)
        measured = u + 0.02 * generator.standard_normal(len(u))
        kept = slice(-4 * PERIOD, None)
        shown += judged([Recording(measured[kept], (y - y.mean())[kept], 1.0)]).shown
    assert shown <= 1


def test_of_a_regular_grid_it_is_the_least_there_can_be():
    gain = best_gain(wiener, ODD, 150)
    for seed in range(5):
        made, clean = record(wiener, ODD, np.random.default_rng(seed))
        found = judged([made])
        (parts,) = found.outputs
        assert not found.separated
        assert found.shown
        truth = 100.0 * np.sqrt(known_distortion(made, clean, ODD, gain))
        assert 0.3 * truth < parts.distortion.percent < truth


def test_levels_are_the_deviations_of_the_gain_that_the_data_give():
    """White noise of variance 1 moves each coefficient of a mean of periods by 1/(P T)."""
    lines, noise = with_gaps(ODD, np.random.default_rng(1)), []
    for seed in range(20):
        generator = np.random.default_rng(seed)
        u = np.tile(multisine(generator, lines), 7)
        y = 10.0 * linear(u) + generator.standard_normal(len(u))
        made = Recording(u[-3 * PERIOD :], y[-3 * PERIOD :], 1.0)
        found = judged([made])
        (levels,) = found.levels
        noise.append(levels.noise)
        assert_allclose([levels.frequency_hz[0], levels.frequency_hz[-1]], lines[[0, -1]] / PERIOD)
    expected = 1.0 / (found.periods * PERIOD * np.mean(np.abs(coefficients(u)[lines]) ** 2))
    assert_allclose(np.mean(np.square(noise)), expected, rtol=0.1)
    gain = best_gain(wiener, lines, 150)
    made, clean = record(wiener, lines, np.random.default_rng(2))
    (levels,) = judged([made]).levels
    at = coefficients(clean)[lines], coefficients(made.input)[lines]
    off = np.abs(at[0] / at[1] - gain)
    assert_allclose(np.linalg.norm(levels.distortion), np.linalg.norm(off), rtol=0.5)


@pytest.mark.parametrize(("power", "share"), [(2, 1.0), (3, 0.0)])
def test_squares_fall_on_even_lines_and_cubes_on_odd_ones(power, share):
    lines = with_gaps(ODD, np.random.default_rng(1))
    made, _ = record(lambda u: linear(u + 0.1 * u**power), lines, np.random.default_rng(3))
    found = judged([made])
    assert found.outputs[0].even_share == pytest.approx(share, abs=0.03)
    assert f"mostly {'odd' if share < 0.5 else 'even'}" in error_parts(found)[0]


EXCITED = np.random.default_rng(0).standard_normal(200_000)
# Gain of the best linear approximation over that of the linear part under a Gaussian input
# (Bussgang 1952), of 1 and of the variance of the response.
BUSSGANG = {linear: 1.0, hammerstein: 1.21, wiener: 1.0 + 0.03 * np.var(linear(EXCITED))}


def random_record(system, seed, samples, noise=0.02, scale=1.0):
    """A random recording, held out in part, and the true part of a model off by a factor."""
    generator = np.random.default_rng(seed)
    u = generator.standard_normal(samples + 500)
    y = system(u) - np.mean(system(EXCITED))
    v = lfilter([1.0], [1.0, -0.8], generator.standard_normal(len(u)))
    y, gain = y + noise * np.std(y) * v / np.std(v), BUSSGANG[system]
    model = PolynomialModel(A=[1.0], B=[scale * gain * B[1:]], F=[A], nk=[1])
    held_out = divided(model, Recording(u[500:], y[500:], 1.0), samples // 3)
    part = 100.0 * abs(scale - 1.0) * gain * np.std(linear(u)[500:]) / np.std(y[500:])
    return held_out, part


@pytest.mark.parametrize("system", [linear, wiener, hammerstein])
def test_the_floor_of_a_random_input_is_below_what_no_linear_model_removes(system):
    above, parts = [], []
    for seed in range(30):
        held_out, part = random_record(system, seed, 2000, scale=1.2)
        (floor,) = floors_of(Distortion("no periods"), held_out, False)
        assert not floor.reached
        parts.append((floor.rest.percent, part))
        squares = floor.floor.percent**2 + floor.rest.percent**2
        assert squares == pytest.approx(floor.error_percent**2)
        above.append(part > floor.rest.high)
    stated, true = np.sqrt(np.mean(np.square(parts), axis=0))
    assert stated == pytest.approx(true, rel=0.05)
    # Of 30 upper limits of 97.5 % four or more are too low in 0.6 % of all cases.
    assert np.sum(above) <= 3


def test_a_model_at_the_floor_of_a_random_input_is_told():
    for system in (wiener, hammerstein):
        found = [
            floors_of(Distortion("no periods"), random_record(system, seed, 3000)[0], False)
            for seed in range(10)
        ]
        assert np.mean([floor.reached for (floor,) in found]) >= 0.9


def test_no_floor_is_told_of_a_few_samples_or_a_long_memory():
    few, _ = random_record(linear, 1, 120)
    slow = PolynomialModel(A=[1.0], B=[[1.0]], F=[[1.0, -0.999]], nk=[1])
    u = np.random.default_rng(2).standard_normal(2000)
    long = divided(slow, Recording(u, lfilter([0.0, 1.0], [1.0, -0.999], u), 1.0), 500)
    assert floors_of(Distortion("no periods"), few, False) == ()
    assert floors_of(Distortion("no periods"), long, False) == ()


def test_the_floor_of_a_periodic_input_is_what_is_not_the_models():
    parts = ErrorParts("y", 5.0, Part(3.0, 3.0, 3.0), Part(3.9, 3.5, 3.97), Part(0.9, 0.5, 2.0))
    split = Distortion("", "validation", 512, 3, 1, 1e-9, True, (parts,))
    (floor,) = floors_of(split, (), False)
    assert (floor.reached, floor.floor.low) == (True, pytest.approx(np.sqrt(21.0)))
    assert floors_of(replace(split, separated=False), (), False) == ()


def test_transients_are_left_out():
    lines = with_gaps(ODD, np.random.default_rng(1))
    u = np.tile(multisine(np.random.default_rng(3), lines), 6)
    slow = np.exp(-np.arange(len(u)) / 300.0)
    y = linear(u) + 5.0 * slow + 0.01 * np.random.default_rng(4).standard_normal(len(u))
    found = judged([Recording(u, y - y[PERIOD:].mean(), 1.0)])
    assert 2 <= found.periods <= 3
    assert not found.shown


def test_two_recordings_of_one_realisation_count_once():
    lines = np.arange(3, 181)
    made = [record(hammerstein, lines, np.random.default_rng(5))[0] for _ in range(3)]
    shifted = replace(made[1], inputs=np.roll(made[1].inputs, 40, axis=0))
    assert judged([made[0], made[1], shifted]).realisations == 1


def test_an_input_that_rests_for_some_periods_is_judged_by_the_others():
    """A set point that moves on five days of the week: the two others repeat as well."""
    day = np.zeros(96)
    day[30:70] = 1.0
    u = np.concatenate([np.zeros(2 * 96), np.tile(day, 5)])
    y = linear(u) + 0.02 * np.random.default_rng(6).standard_normal(len(u))
    assert realisations_of(u[:, None]) == (96, [slice(0, 222), slice(166, 672)])
    assert judged([Recording(u, y, 1.0)]).realisations <= 1


@pytest.mark.parametrize(
    ("u", "reason"),
    [
        (np.random.default_rng(0).standard_normal(1200), "does not repeat"),
        (np.tile(np.random.default_rng(1).standard_normal(300), 4), "other phases"),
    ],
)
def test_it_is_not_judged_without_lines_that_show_it(u, reason):
    found = judged([Recording(u, linear(u), 1.0)])
    assert reason in found.reason
    assert not found.outputs
    assert not found.shown
    assert error_parts(found) == []


def test_the_error_in_words():
    parts = ErrorParts("y", 6.4, Part(1.1, 1.0, 1.2), Part(4.9, 4.2, 5.6), Part(4.0, 3.1, 4.7))
    found = Distortion("", "validation", 512, 3, 1, 1e-9, True, (parts,))
    (text,) = error_parts(found)
    for words in (
        "6.40",
        "1.1",
        "4.9",
        "4.2",
        "5.6",
        "4.0",
        "3 periods",
        "no linear model removes",
    ):
        assert words in text
    assert "at least" not in text
    assert "at least 4.9" in error_parts(replace(found, separated=False))[0]
    (floor,) = floors_of(found, (), False)
    assert "as good as a linear model" not in error_parts(found, [floor])[0]
    reached = replace(floor, floor=Part(6.0, 5.9, 6.1), rest=Part(1.0, 0.5, 2.4))
    assert "as good as a linear model" in error_parts(found, [reached])[0]
    assert "at most 2.4" in error_parts(Distortion("no"), [reached])[0]
    none = replace(found, p_value=0.4)
    assert "4.0 % this model; no nonlinear distortion shows" in spaced(error_parts(none)[0])
    untold = spaced(error_parts(replace(none, separated=False))[0])
    assert "4.0 % this model or distortion at the lines of the input" in untold
    assert "no nonlinear" not in untold
    assert found.prevails
    assert not none.prevails
    assert not replace(found, outputs=(replace(parts, rest=Part(5.0, 4.0, 6.0)),)).prevails


@pytest.mark.parametrize("poles", [[1.0, -0.5], [1.0, -2.0 * np.cos(np.pi / 30.0), 1.0]])
@pytest.mark.parametrize("gain", [0.0, 1.0])
def test_a_constant_output_and_a_pole_at_a_line_are_not_judged(poles, gain):
    u = np.sin(np.pi * np.arange(600) / 30.0)
    model = PolynomialModel(A=[1.0], B=[[1.0]], F=[poles], nk=[1])
    y = gain * np.random.default_rng(0).standard_normal(600)
    found = distortion_of(stretches_of(model, Recording(u, y, 1.0)), (), False)
    assert bool(found.reason) is (gain == 0.0 or len(poles) > 2)
    assert all(np.isfinite(each.noise.percent) for each in found.outputs)
