"""Random recordings through preparation, search and validation: a finite model, or one sentence."""

import json
import re
import warnings

import numpy as np
from scipy.signal import lfilter

from evopem.config.defaults import complete
from evopem.config.order_grid import check_samples, sample_requirements, scoring_window
from evopem.errors import InputError
from evopem.estimation.model_record import ModelRecord
from evopem.estimation.order_selection import OrderSearch, complete_estimate, estimate_candidates
from evopem.files.json_form import to_json
from evopem.models.orders import armax_orders
from evopem.models.response_tables import frequency_response_table
from evopem.signals.peaks import summarize_spectrum
from evopem.signals.preparation import prepare
from evopem.signals.recording import Recording
from evopem.signals.recording_checks import check_recording
from evopem.signals.spectra import multitaper_spectrum
from evopem.validation.validate import validate

ORDERS = armax_orders(2, 2, 1, 1)
GRID = {
    "delay": {"orders": [2, 2], "nk": [0, 1]},
    "orders": {"plant": [2, 2], "nc": [1, 2], "nb": [1, 2]},
}


RECORDINGS = 250


def one_of(generator, *values):
    return values[generator.integers(len(values))]


def signal(generator, samples):
    """A signal of many kinds: noise, steps, sines, trends, few levels, spikes, at any scale."""
    white = generator.standard_normal(samples)
    steps = np.arange(samples)
    kinds = {
        "white": white,
        "walk": np.cumsum(white),
        "sine": np.sin(generator.uniform(0.001, 3.1) * steps),
        "levels": np.round(white * generator.uniform(0.1, 4)),
        "spikes": np.where(generator.random(samples) < 0.01, 1.0, 0.0),
        "step": np.where(steps < generator.integers(samples), 0.0, 1.0),
        "trend": steps + generator.uniform(0, 10) * white,
        "constant": np.ones(samples),
    }
    exponent = one_of(generator, 0, 0, 0, 0, -300, -70, -50, -10, 10, 50, 70, 300)
    offset = one_of(generator, 0.0, 0.0, 1.0, -1e3, 1e12)
    with np.errstate(over="ignore"):
        return (one_of(generator, *kinds.values()) + offset) * 10.0**exponent


def recording_of(generator):
    samples = int(generator.integers(1, 400))
    u = signal(generator, samples)
    if generator.random() < 0.4:
        y = signal(generator, samples)
    else:
        noise = one_of(generator, 0.0, 1e-9, 0.1, 1.0) * np.abs(u).max()
        with np.errstate(all="ignore"):
            y = lfilter([0, 1, 0.5], [1, -1.5, 0.7], u) + noise * generator.standard_normal(samples)
    return Recording(u, y, one_of(generator, 0.001, 1.0, 100.0, 1e6))


def settings_of(generator):
    keys = {
        "synthesis": "armax",
        "transforms": {
            "box_cox": one_of(generator, "none", "none", "auto", 1.1, 0, -2.5),
            "difference": int(generator.integers(5)),
            "difference_input": int(generator.integers(5)),
        },
        "split": {
            "discard": one_of(generator, int(generator.integers(50)), generator.uniform(0.01, 0.9)),
            "estimation": one_of(
                generator, int(generator.integers(1, 400)), generator.uniform(0.1, 0.9)
            ),
        },
        "search": {
            "objective": one_of(generator, "absolute", "quadratic"),
            "mu": 3,
            "lambda": 6,
            "nu": 2,
            "evaluations": 60,
            "n_initial_discard": 5,
        },
    }
    written = {"datasets": {"bench": keys}, "defaults": {"recipe": "chapter"} | GRID}
    return complete(written).datasets["bench"]


def identified(recording, settings):
    """The model of a recording, or None where it is refused in a sentence."""
    window, search = scoring_window(settings), settings.search
    try:
        check_recording(recording, "bench.csv")
        prepared = prepare(recording, settings.preparation, place="datasets.bench")
        counts = (prepared.estimation.samples, prepared.validation.samples)
        check_samples(sample_requirements(settings), *counts, "datasets.bench")
    except InputError as refused:
        refusal = str(refused)
    else:
        refusal = ""
    if refusal:
        assert re.fullmatch(r"(bench\.csv|datasets\.bench\.).*: .+; .+\.", refusal)
        return None
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        spectrum = summarize_spectrum(multitaper_spectrum(prepared.estimation.output, 1.0, 2.0, 64))
        data = prepared.estimation
        (candidate,) = estimate_candidates(OrderSearch(data, search, window), [ORDERS], "nb")
        found = complete_estimate(candidate, data, search, window)
        validation, _ = validate(found.model, prepared)
        record = ModelRecord.of(found, data, search, prepared.transforms)
        frequency_response_table(found.model, data.input_names, data.output_names)
        validation.modes.rows(data.input_names, data.output_names)
    written = to_json((spectrum, candidate, record, validation))
    assert json.loads(json.dumps(written, allow_nan=False))
    assert np.isfinite(validation.prediction_error_percent)
    return record.model


def test_any_recording_gives_a_finite_model_or_one_sentence():
    models = []
    for number in range(RECORDINGS):
        generator = np.random.default_rng(number)
        models.append(identified(recording_of(generator), settings_of(generator)))
    found = [model for model in models if model is not None]
    assert RECORDINGS / 10 < len(found) < RECORDINGS
    for model in found:
        assert np.isfinite(model.parameters).all()
        assert np.abs(model.poles()).max() < 1.0
        assert np.abs(model.noise_zeros()).max() < 1.0
