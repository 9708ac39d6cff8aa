"""A complete set of result files, made from a known ARMAX system, for figures and report."""

from __future__ import annotations

import json
import math
from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path

import numpy as np
import pandas as pd
import yaml
from scipy.signal import lfilter

from evopem.models.armax import ArmaxModel, Orders
from evopem.models.parameter_covariance import ParameterCovariance
from evopem.signals.preparation import PreparedData, prepare, save_prepared
from evopem.signals.recording import Recording, describe_recording, save_recording
from evopem.signals.spectral.multitaper import (
    multitaper_frequency_response,
    multitaper_spectrum,
    spectral_peaks,
)
from evopem.validation import validate

# The modes of table 2 of the chapter, a real pole beside them.
MODES = ((5.36, 0.0091), (16.65, 0.175), (37.0, 0.0107))
RATE = 100.0


def true_model() -> ArmaxModel:
    """ARMAX(7, 6, 7, 3) with the chapter's modes."""
    poles = [0.4 + 0j]
    for frequency, damping in MODES:
        omega = 2 * math.pi * frequency / RATE
        pole = np.exp(omega * complex(-damping, math.sqrt(1 - damping**2)))
        poles += [pole, pole.conjugate()]
    noise = np.poly([0.3, 0.8 * np.exp(0.5j), 0.8 * np.exp(-0.5j), 0.7j, -0.7j, -0.6, -0.5])
    b = 0.05 * np.array([1.0, -0.7, 0.4, 0.5, -0.3, 0.2])
    return ArmaxModel(np.real(np.poly(poles)), b, np.real(noise), 3, RATE, 0.02**2)


def record(samples: int = 5000, seed: int = 1, output_name: str = "tip acceleration") -> Recording:
    """The true model's response to white noise, with an offset to be removed."""
    model = true_model()
    rng = np.random.default_rng(seed)
    u = rng.normal(size=samples)
    e = math.sqrt(model.noise_variance) * rng.normal(size=samples)
    y = lfilter(model.delayed_b, model.a, u) + lfilter(model.c, model.a, e)
    return Recording(u, y + 3.0, RATE, "motor velocity", output_name, "rad/s", "m/s²")


def _regressors(columns: Sequence[tuple[np.ndarray, range]], start: int) -> np.ndarray:
    return np.column_stack([x[start - lag : x.size - lag] for x, lags in columns for lag in lags])


def fit_linear(data: Recording, orders: Orders, innovations: np.ndarray, start: int) -> dict:
    """A candidate by linear regression on estimated innovations (Hannan and Rissanen 1982)."""
    y, u = data.output, data.input
    phi = _regressors(
        (
            (-y, range(1, orders.na + 1)),
            (u, range(orders.nk, orders.nk + orders.nb)),
            (innovations, range(1, orders.nc + 1)),
        ),
        start,
    )
    p = np.linalg.lstsq(phi, y[start:], rcond=None)[0]
    e = y[start:] - phi @ p
    n = e.size
    a = [1.0, *p[: orders.na]]
    return {
        **asdict(orders),
        "a": a,
        "b": list(p[orders.na : orders.na + orders.nb]),
        "c": [1.0, *p[orders.na + orders.nb :]],
        "rss": 100 * float(e @ e) / float(y[start:] @ y[start:]),
        "bic": math.log(float(e @ e) / n) + p.size * math.log(n) / n,
        "objective": 100 * float(np.abs(e).sum() / np.abs(y[start:]).sum()),
        "evaluations": 800 + 40 * p.size,
        "max_pole_radius": float(np.max(np.abs(np.roots(a)))),
        "max_zero_radius": 0.9,
        "at_margin": False,
        "generations": 11,
        "populations": 6,
        "basins": 2,
        "checked": 64,
        "unseen": 0.0015,
        "agreement": 0.8,
        "convergence": [[k * 115, 12.0 + 5.0 * math.exp(-0.7 * k)] for k in range(12)],
    }


def phases(data: Recording) -> dict[str, dict]:
    """Candidates of the four sweeps, with the chapter's choices."""
    start = 120
    long_arx = _regressors(((data.output, range(1, 41)), (data.input, range(41))), 40)
    weights = np.linalg.lstsq(long_arx, data.output[40:], rcond=None)[0]
    innovations = np.concatenate([np.zeros(40), data.output[40:] - long_arx @ weights])
    sweeps = {
        "delay": [Orders(k, k, k, nk) for k in range(6, 10) for nk in range(4)],
        "common": [Orders(k, k, k, 3) for k in range(6, 15)],
        "c": [Orders(7, 7, k, 3) for k in range(2, 17)],
        "b": [Orders(7, k, 7, 3) for k in range(2, 17)],
    }
    choices = {
        "delay": Orders(7, 7, 7, 3),
        "common": Orders(7, 7, 7, 3),
        "c": Orders(7, 7, 7, 3),
        "b": Orders(7, 6, 7, 3),
    }
    return {
        phase: {
            "phase": phase,
            "candidates": [
                {"phase": phase, **fit_linear(data, orders, innovations, start)} for orders in grid
            ],
            "selected": asdict(choices[phase]),
            "reason": "It has the smallest BIC.",
        }
        for phase, grid in sweeps.items()
    }


def with_covariance(model: ArmaxModel, data: Recording) -> ArmaxModel:
    """The model with the covariance σ² (ψᵀψ)⁻¹ of its parameters."""
    e = np.nan_to_num(model.residuals(data.input, data.output))
    y_f, u_f, e_f = (lfilter([1.0], model.c, x) for x in (data.output, data.input, e))
    orders = model.orders
    psi = _regressors(
        (
            (y_f, range(1, orders.na + 1)),
            (-u_f, range(orders.nk, orders.nk + orders.nb)),
            (-e_f, range(1, orders.nc + 1)),
        ),
        200,
    )
    covariance = ParameterCovariance.from_matrix(model.noise_variance * np.linalg.inv(psi.T @ psi))
    return ArmaxModel(
        model.a, model.b, model.c, model.nk, model.sampling_rate, model.noise_variance, covariance
    )


def model_json(model: ArmaxModel, prepared: PreparedData) -> dict:
    """The model as the results hold it."""
    modes = [
        {
            "frequency_hz": mode.frequency_hz,
            "damping_percent": 100 * mode.damping_ratio,
            "frequency_se_hz": mode.frequency_se_hz,
            "damping_se_percent": 100 * mode.damping_se,
            "pole": [mode.pole.real, mode.pole.imag],
        }
        for mode in model.modes()
    ]
    covariance = model.covariance
    assert covariance is not None
    return {
        "evopem": "0.1.0",
        "orders": asdict(model.orders),
        "a": model.a.tolist(),
        "b": model.b.tolist(),
        "c": model.c.tolist(),
        "sampling_rate": model.sampling_rate,
        "noise_variance": model.noise_variance,
        "objective": {"name": "absolute", "value": 12.0},
        "fit_percent": 88.0,
        "rss": 1.7,
        "bic": -7.79,
        "covariance": covariance.matrix.tolist(),
        "parameter_standard_errors": np.sqrt(np.diag(covariance.matrix)).tolist(),
        "modes": modes,
        "poles": [[root.real, root.imag] for root in model.poles()],
        "zeros": [[root.real, root.imag] for root in model.zeros()],
        "transforms": asdict(prepared.transforms),
        "search": {
            "settings": {
                "mu": 15,
                "lambda": 100,
                "nu": 10,
                "mutate": "worst",
                "evaluations": 20000,
                "max_root_radius": 0.9999,
            },
            "found": {
                "evaluations": 1600,
                "generations": 11,
                "populations": 6,
                "agreement": 0.8,
                "basins": 2,
                "at_margin": False,
                "checked": 64,
                "unseen": 0.0015,
            },
        },
        "seed": 1,
        "versions": {"evopem": "0.1.0", "numpy": np.__version__, "python": "3.11"},
        "scoring_start": 118,
    }


def write_results(
    directory: Path,
    samples: int = 5000,
    output_name: str = "tip acceleration",
    dataset: str = "arm",
) -> Path:
    """Write every result file but figures and report into a directory."""
    directory.mkdir(parents=True, exist_ok=True)
    recording = record(samples, output_name=output_name)
    prepared = prepare(
        recording,
        {"box_cox": "none", "difference": 0, "difference_input": 0},
        {"discard": min(500, samples // 10), "estimation": 0.8},
    )
    data = prepared.estimation
    model = with_covariance(true_model(), data)
    save_recording(recording, directory / "recording.npz")
    save_prepared(prepared, directory / "prepared.npz", directory / "transforms.json")
    spectrum = multitaper_spectrum(data.output, RATE)
    response = multitaper_frequency_response(data.input, data.output, RATE)
    pd.DataFrame(
        {
            "frequency_hz": spectrum.frequencies,
            "density": spectrum.density,
            "lower": spectrum.lower,
            "upper": spectrum.upper,
            "input_density": multitaper_spectrum(data.input, RATE).density,
            "frequency_response_gain": response.gain,
            "frequency_response_gain_lower": response.gain_lower,
            "frequency_response_gain_upper": response.gain_upper,
            "frequency_response_phase_deg": response.phase_deg,
            "coherence": response.coherence,
        }
    ).to_csv(directory / "spectrum.csv", index=False)
    searched = phases(data)
    candidates = pd.DataFrame(
        [
            {
                **{key: value for key, value in candidate.items() if np.isscalar(value)},
                "selected": all(
                    candidate[key] == value for key, value in phase["selected"].items()
                ),
            }
            for phase in searched.values()
            for candidate in phase["candidates"]
        ]
    )
    candidates.to_csv(directory / "candidates.csv", index=False)
    (directory / "phases").mkdir(exist_ok=True)
    frequencies = spectrum.frequencies[1:]
    g = model.frequency_response(frequencies)
    pd.DataFrame(
        {
            "frequency_hz": frequencies,
            "gain": np.abs(g),
            "gain_lower": 0.95 * np.abs(g),
            "gain_upper": 1.05 * np.abs(g),
            "phase_deg": np.degrees(np.angle(g)),
        }
    ).to_csv(directory / "frequency_response.csv", index=False)
    validation = validate(model, prepared)
    validation.residual_autocorrelation.to_csv(
        directory / "residual_autocorrelation.csv", index=False
    )
    validation.cross_correlation.to_csv(directory / "cross_correlation.csv", index=False)
    validation.simulation.to_csv(directory / "simulation.csv", index=False)
    as_json = model_json(model, prepared)
    pd.DataFrame(
        [
            {
                **{key: value for key, value in mode.items() if key != "pole"},
                "pole_real": mode["pole"][0],
                "pole_imag": mode["pole"][1],
                "radius": abs(complex(*mode["pole"])),
            }
            for mode in as_json["modes"]
        ]
    ).to_csv(directory / "modes.csv", index=False)
    contents = {
        "recording.json": {
            "kind": "synthesis",
            "path": None,
            "sha256": None,
            **describe_recording(recording),
        },
        "spectrum.json": {
            "time_halfbandwidth": 4,
            "tapers": 7,
            "nfft": 8192,
            "resolution_hz": 2 * spectrum.halfbandwidth_hz,
            "peaks": [asdict(peak) for peak in spectral_peaks(spectrum)],
        },
        "model.json": as_json,
        "validation.json": validation.scalars(),
        "truth.json": {
            "kind": "flexible_arm",
            "orders": as_json["orders"],
            "seed": 1,
            "delay_samples": 3,
            "modes": [
                {"frequency_hz": frequency, "damping_percent": 100 * damping}
                for frequency, damping in MODES
            ],
        },
        **{f"phases/{phase}.json": content for phase, content in searched.items()},
    }
    for name, content in contents.items():
        (directory / name).write_text(json.dumps(content, allow_nan=False), encoding="utf-8")
    source = {"synthesis": "flexible_arm", "seed": 1, "samples": samples}
    (directory / "config.yaml").write_text(
        yaml.safe_dump({"datasets": {dataset: source}}, sort_keys=False), encoding="utf-8"
    )
    return directory
