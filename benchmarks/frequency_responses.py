"""Models of frequency responses: coverage of their intervals, and the same records in time.

    python benchmarks/frequency_responses.py

prints the tables of docs/evidence/frequency.md; it takes some minutes.
"""

import sys

import numpy as np

import evopem
from evopem import FrequencyResponses, fit_responses

HERTZ, DAMPING = np.array([12.0, 31.0]), np.array([0.02, 0.015])
SHAPES, DRIVES = np.array([[1.0, 0.6], [-0.7, 1.0]]), np.array([1.0, 0.8])
FREQUENCIES = np.linspace(1.0, 50.0, 120)
RATE, PERIOD, PERIODS = 120.0, 1200, 2


def coverage(kind: str, runs: int) -> np.ndarray:
    """Share of 95 % intervals that hold the truth, of frequency and damping."""
    generator = np.random.default_rng(0)
    omega, s = 2.0 * np.pi * HERTZ, 2j * np.pi * FREQUENCIES[:, None, None]
    exact = sum(
        np.outer(SHAPES[k], DRIVES[k : k + 1])
        * omega[k] ** 2
        / (s**2 + 2.0 * DAMPING[k] * omega[k] * s + omega[k] ** 2)
        for k in range(2)
    )
    deviation = 0.4 * (1.0 + FREQUENCIES[:, None, None] / 50.0 * (kind != "unknown"))
    deviation = deviation * np.ones(exact.shape)
    hits = []
    for _ in range(runs):
        parts = generator.standard_normal((2, *exact.shape)) / np.sqrt(2.0)
        given = FrequencyResponses(
            FREQUENCIES,
            exact + deviation * (parts[0] + 1j * parts[1]),
            None if kind == "unknown" else deviation**2,
            are_absolute=kind == "absolute",
        )
        modes = fit_responses(given, modes=(2, 2)).model.modes()
        found = np.array([(mode.frequency_hz, mode.damping_ratio) for mode in modes])
        errors = np.array([(mode.frequency_se_hz, mode.damping_se) for mode in modes])
        hits.append(np.abs(found - np.column_stack([HERTZ, DAMPING])) < 1.96 * errors)
    return np.mean(hits, axis=(0, 1))


def routes(runs: int) -> np.ndarray:
    """Root mean square errors (%) of frequencies, damping and response: by lines, in time."""
    poles = np.exp(2.0 * np.pi * HERTZ / RATE * (-DAMPING + 1j * np.sqrt(1.0 - DAMPING**2)))
    F = np.poly(np.concatenate([poles, poles.conj()])).real
    truth = evopem.PolynomialModel([1.0], [0.0, 0.4, 0.1, 0.3, 0.2], F=F, sampling_rate=RATE)
    lines = np.arange(1, PERIOD // 2)
    expected = truth.frequency_response(lines * RATE / PERIOD)[:, 0, 0]
    errors = []
    for seed in range(runs):
        generator = np.random.default_rng(seed)
        phases = np.exp(2j * np.pi * generator.uniform(size=lines.size))
        u = np.tile(np.fft.irfft(np.r_[0.0, phases, 0.0], PERIOD) * np.sqrt(PERIOD), PERIODS + 1)
        y = np.asarray(truth.simulate(u)).ravel()
        noise = 0.1 * float(np.std(y))
        u, y = u[PERIOD:], y[PERIOD:] + noise * generator.standard_normal(PERIODS * PERIOD)
        spectra = [np.fft.rfft(x.reshape(PERIODS, -1).mean(axis=0))[lines] for x in (u, y)]
        variances = noise**2 * PERIOD / PERIODS / np.abs(spectra[0]) ** 2
        given = FrequencyResponses(
            lines * RATE / PERIOD, spectra[1] / spectra[0], variances, sampling_rate=RATE
        )
        settings = evopem.SearchSettings(objective="quadratic", seed=seed)
        orders = {"nb": 5, "nf": 4, "nk": 0}
        in_time = evopem.estimate(u, y, orders, RATE, structure="oe", settings=settings)
        row = []
        for model in (fit_responses(given, modes=(2, 2)).model, in_time.model):
            modes = model.modes()
            response = np.asarray(model.frequency_response(given.frequencies))[:, 0, 0]
            row.append((
                *(mode.frequency_hz / f - 1.0 for mode, f in zip(modes, HERTZ, strict=True)),
                *(mode.damping_ratio / d - 1.0 for mode, d in zip(modes, DAMPING, strict=True)),
                np.linalg.norm(response - expected) / np.linalg.norm(expected),
            ))  # fmt: skip
        errors.append(row)
    return 100.0 * np.sqrt(np.mean(np.square(errors), axis=0))


if __name__ == "__main__":
    runs = int(sys.argv[1]) if len(sys.argv) > 1 else 200
    print("| by lines, in time |", np.round(routes(max(runs // 5, 2)), 4).tolist(), flush=True)
    for kind in ("absolute", "factor", "unknown"):
        print(f"| {kind} |", coverage(kind, runs), flush=True)
