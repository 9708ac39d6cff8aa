"""Hard records: each gives a right model or a check that fails, never a wrong one in silence."""

import numpy as np
import pytest
from scipy.signal import lfilter

from evopem.config.settings import (
    PreparationSettings,
    ScoringWindow,
    SearchSettings,
    SplitSettings,
    TransformSettings,
)
from evopem.estimation.model_record import ModelRecord
from evopem.estimation.order_candidate import PhaseSelection
from evopem.estimation.order_selection import OrderSearch, complete_estimate, estimate_candidates
from evopem.models.orders import armax_orders
from evopem.signals.peaks import SpectrumSummary
from evopem.signals.preparation import prepare
from evopem.signals.recording import Recording
from evopem.signals.recording_info import describe_recording
from evopem.validation.checks import Evidence, checks
from evopem.validation.checks.search import ranges_of_phases
from evopem.validation.validate import validate

PREPARATION = PreparationSettings(TransformSettings("none", 0, 0), SplitSettings(discard=50))
NO_PEAKS = SpectrumSummary(4.0, 7, 2048, 1, 0.1, (), 0)
RATE, SAMPLES = 100.0, 2000
WINDOW = ScoringWindow(40, 60)
POLE = 0.95 * np.exp(0.6j)
A = np.real(np.poly([POLE, np.conj(POLE)]))
B, C = [0.0, 1.0, 0.5], [1.0, 0.3]
FREQUENCY = abs(np.log(POLE)) * RATE / (2 * np.pi)
WHITE = np.random.default_rng(5).standard_normal(SAMPLES)
STEPS = np.arange(SAMPLES)


def response(u=WHITE, a=A, b=B, innovations=None):
    """Output of the system, with a tenth of noise."""
    clean = lfilter(b, a, u)
    e = np.random.default_rng(1).standard_normal(SAMPLES)
    size = 0.1 * np.std(clean) / np.std(lfilter(C, a, e))
    return clean + size * lfilter(C, a, e if innovations is None else innovations)


def judged(u, y, orders=(2, 2, 1, 1), objective="absolute"):
    """The modes' frequencies, and the names of the checks that fail."""
    record, orders = Recording(u, y, RATE), armax_orders(*orders)
    prepared = prepare(record, PREPARATION)
    settings = SearchSettings(objective=objective, mu=5, lambda_=20, nu=5, evaluations=3000)
    data = prepared.estimation
    (candidate,) = estimate_candidates(OrderSearch(data, settings, WINDOW), [orders], "nb")
    found = complete_estimate(candidate, data, settings, WINDOW)
    model = ModelRecord.of(found, data, settings, prepared.transforms)
    validation, _ = validate(found.model, prepared, objective)
    # Every order is given, so no range was searched.
    phases = {
        phase: PhaseSelection(phase, orders, "Given.", (candidate,))
        for phase in ("delay", "plant", "nc", "nb")
    }
    info = describe_recording(record)
    results = checks(Evidence(model, validation, info, ranges_of_phases(phases)))
    frequencies = [mode.frequency_hz for mode in model.modes]
    return frequencies, {check.name for check in results if check.passed is False}


def test_a_good_record_gives_a_right_model_and_no_failed_check():
    (frequency,), failed = judged(WHITE, response())
    assert frequency == pytest.approx(FREQUENCY, rel=2e-3)
    assert failed == set()


def test_sixteen_bits_are_enough():
    y = response()
    step_u, step_y = 4.0 / 2**15, np.abs(y).max() / 2**15
    (frequency,), failed = judged(np.round(WHITE / step_u) * step_u, np.round(y / step_y) * step_y)
    assert frequency == pytest.approx(FREQUENCY, rel=2e-3)
    assert failed == set()


INTEGRATED = np.convolve(A, [1.0, -1.0])
UNDAMPED = np.real(np.poly([np.exp(0.6j), np.exp(-0.6j)]))
NEARLY_CANCELLED = {"a": np.convolve(A, [1, -0.7]), "b": np.convolve(B, [1, -0.7002])}
SINE = np.sin(0.3 * STEPS)
TWO_SINES = SINE + np.sin(0.9 * STEPS)
CHANGED = np.concatenate([response()[:1000], response(a=np.poly([0.9, 0.2]))[1000:]])
CAUGHT = {
    "a pole at one": (WHITE, response(a=INTEGRATED), (3, 2, 1, 1), "Roots inside"),
    "poles on the unit circle": (WHITE, response(a=UNDAMPED), (2, 2, 1, 1), "Roots inside"),
    "orders far too large": (WHITE, response(), (8, 8, 8, 1), "Poles and zeros"),
    "a pole that a zero hides": (WHITE, response(**NEARLY_CANCELLED), (3, 3, 1, 1), "Poles and"),
    "an input of one frequency": (SINE, response(SINE), (2, 2, 1, 1), "Excitation"),
    "an input of two frequencies": (TWO_SINES, response(TWO_SINES), (4, 4, 2, 1), "Excitation"),
    "an output that is the input": (WHITE, 2.0 * WHITE, (2, 3, 1, 0), "Poles and zeros"),
    "an output cut off": (WHITE, np.clip(response(), -3, 3), (2, 2, 1, 1), "Record not"),
    "an output of its own": (WHITE, WHITE[::-1].copy(), (2, 2, 1, 1), "Response to the input"),
    "channels out of step": (WHITE, np.roll(response(), 5), (2, 2, 1, 1), "Residuals independent"),
    "a nonlinear system": (WHITE, response() ** 3, (2, 2, 1, 1), "White residuals"),
    "a system that changed": (WHITE, CHANGED, (2, 2, 1, 1), "White residuals"),
}


@pytest.mark.parametrize("case", CAUGHT)
def test_what_no_good_model_comes_of_fails_a_check(case):
    u, y, orders, check = CAUGHT[case]
    _, failed = judged(u, y, orders)
    assert any(name.startswith(check) for name in failed), failed


@pytest.mark.parametrize("share", [0.01, 0.1])
def test_outliers_are_told_and_the_absolute_objective_bears_them(share):
    """Innovations of which some are thirty times as large, over four records."""
    errors = {"absolute": [], "quadratic": []}
    for seed in range(4):
        generator = np.random.default_rng(100 + seed)
        e = generator.standard_normal(SAMPLES)
        e = np.where(generator.random(SAMPLES) < share, 30.0 * e, e)
        y = response(innovations=e)
        for objective, found in errors.items():
            (frequency, *_), failed = judged(WHITE, y, objective=objective)
            found.append(frequency / FREQUENCY - 1.0)
            told = "Few residual outliers" in failed
            assert told == (objective == "quadratic" or share > 0.05)
    absolute, quadratic = (np.sqrt(np.mean(np.square(each))) for each in errors.values())
    assert absolute < 3e-3
    assert absolute < 0.5 * quadratic
