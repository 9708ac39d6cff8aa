"""The automatic recipe on synthetic systems with known truths, against short peers.

    PYTHONPATH=workflow/scripts python benchmarks/automatic_zoo.py --set development

Each system gives an estimation record and a validation record of the same kind.  Errors are
``100 ||y - yhat|| / ||y - mean(y)||`` of simulations of the validation record, from the initial
state (and with the level) that fits its measured output: against the noise-free output and against
the measured one.  The rules of the recipe were looked at with the development set alone; the
untouched set has other systems.

Peers are ARX by BIC, a subspace denominator with numerator by least squares (order by BIC of the
simulation), and regularised finite impulse responses (TC kernel by marginal likelihood; Chen,
Ohlsson & Ljung 2012).  ``automatic`` takes of these the one that simulates the second half best
when fitted to the first.
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Callable
from typing import NamedTuple

import numpy as np
import pandas as pd
from scipy.linalg import block_diag, cho_factor, cho_solve, toeplitz
from scipy.signal import chirp, lfilter

import evopem
from evopem.automatic.cross_validation.simulation import simulated
from evopem.estimation.search.linear_estimates import subspace_denominator
from evopem.models.polynomial import PolynomialModel
from evopem.models.polynomial_roots import reflect_into_disc
from evopem.signals.recording import Segment

Array = np.ndarray
Random = np.random.Generator


class Record(NamedTuple):
    """Input, noise-free output and measured output."""

    input: Array
    truth: Array
    measured: Array


def poles(*pairs: tuple[float, float]) -> Array:
    """Denominator with poles of given radius and angle, conjugates added; angle 0 is real."""
    roots = [r * np.exp(1j * w) for r, w in pairs]
    return np.real(np.poly(roots + [z.conjugate() for z in roots if z.imag]))


def noisy(y: Array, noise: Array, percent: float) -> Array:
    """A signal with noise of a given standard deviation, in percent of the signal's."""
    return y + percent / 100.0 * y.std() * noise / noise.std()


def prbs(g: Random, n: int, hold: int) -> Array:
    """A random binary signal whose levels are held."""
    return np.repeat(g.choice([-1.0, 1.0], n // hold + 1), hold)[:n]


def multisine(g: Random, n: int, first: int, last: int, step: int = 1) -> Array:
    """Lines of equal amplitude and random phase; one period."""
    t = np.arange(n) / n
    lines = np.arange(first, last, step)
    return np.sum(
        np.cos(2 * np.pi * lines[:, None] * t + g.uniform(0, 2 * np.pi, len(lines))[:, None]),
        axis=0,
    ) / np.sqrt(len(lines))


def linear(
    b: Array, f: Array, u: Array, noise: Array, percent: float, delay: int = 1, level: float = 0.0
) -> Record:
    """A linear system with additive noise."""
    y = lfilter(np.concatenate([np.zeros(delay), b]), f, u) + level
    return Record(u, y, noisy(y, noise, percent))


def coloured(g: Random, n: int, c: Array, d: Array) -> Array:
    """Filtered white noise."""
    return lfilter(c, d, g.standard_normal(n))


def ball_and_beam(g: Random, n: int, gain: float, percent: float) -> Record:
    """A double integrator under a lead controller."""
    r, e = prbs(g, n, 40), g.standard_normal(n)
    x, v, u = np.zeros(n), 0.0, np.zeros(n)
    last = 0.0
    for t in range(1, n):
        v += 0.02 * u[t - 1]
        x[t] = x[t - 1] + v
        m = x[t] + percent / 100.0 * 0.5 * e[t]
        u[t] = gain * (0.2 * (r[t] - m) - 2.0 * (m - last))
        last = m
    return Record(u, x, x + percent / 100.0 * 0.5 * e)


def tank(g: Random, n: int, percent: float, exponent: float = 0.5) -> Record:
    """Two tanks in series whose outflow is a power of the level."""
    u = 1.0 + 0.5 * np.repeat(g.uniform(-1.0, 1.0, n // 20 + 1), 20)[:n]
    one = two = 1.0
    y = np.zeros(n)
    for t in range(n):
        y[t] = two
        flow = max(one, 0.0) ** exponent
        one += 0.1 * (u[t] - flow)
        two += 0.1 * (flow - max(two, 0.0) ** exponent)
    return Record(u, y, noisy(y, g.standard_normal(n), percent))


def friction(g: Random, n: int, level: float, percent: float) -> Record:
    """Two masses on a spring with dry friction of the first, ten steps a sample; its speed."""
    u = multisine(g, n, max(n // 60, 2), n // 4, 2)
    x, v1, v2 = 0.0, 0.0, 0.0
    y = np.zeros(n)
    for t in range(n):
        y[t] = v1
        for _ in range(10):
            torque = u[t] - level * np.tanh(50.0 * v1) - 0.3 * x - 0.01 * (v1 - v2)
            v1 += 0.1 * torque
            v2 += 0.1 * (0.3 * x + 0.01 * (v1 - v2) - 0.005 * v2) / 2.0
            x += 0.1 * (v1 - v2)
    return Record(u, y, noisy(y, g.standard_normal(n), percent))


def impulsive(g: Random, n: int, a: Array, b: Array, share: float) -> Record:
    """Rare large disturbances that pass through the poles of the plant."""
    u = g.standard_normal(n)
    e = 0.02 * g.standard_normal(n) + (g.random(n) < share) * g.standard_normal(n)
    y = lfilter(np.concatenate([[0.0], b]), a, u)
    return Record(u, y, y + lfilter([1.0], a, e))


def outlying(record: Record, g: Random, share: float) -> Record:
    """The same record with sensor outliers."""
    n = len(record.truth)
    spikes = (g.random(n) < share) * 8.0 * record.truth.std() * g.standard_normal(n)
    return record._replace(measured=record.measured + spikes)


TWO = poles((0.9, 0.5))
FOUR = poles((0.95, 0.4), (0.9, 1.2))
MANY = poles((0.985, 0.3), (0.98, 0.8), (0.985, 1.3), (0.98, 2.0), (0.97, 2.6))
LINK = poles((0.999, 0.03), (0.997, 0.12))
SLOW = poles((0.97, 0.0), (0.9, 0.0))


def gaussian(g: Random, n: int) -> Array:
    """White noise."""
    return g.standard_normal(n)


def step_levels(g: Random, n: int, hold: int) -> Array:
    """Steps between a few levels."""
    return np.repeat(g.choice([0.0, 1.0, 2.0, 4.0], n // hold + 1), hold)[:n]


System = Callable[[Random], Record]

DEVELOPMENT: dict[str, System] = {
    "OE 2, 300 samples, 20 %": lambda g: linear(
        np.array([1.0, 0.5]), TWO, gaussian(g, 300), gaussian(g, 300), 20.0
    ),
    "BJ 4, coloured input, 30 %": lambda g: linear(
        np.array([1.0, -0.5, 0.3]),
        FOUR,
        coloured(g, 1000, [1.0], [1.0, -0.7]),
        coloured(g, 1000, [1.0, 0.5], [1.0, -0.9]),
        30.0,
    ),
    "ARMAX 2, 500 samples, 30 %": lambda g: linear(
        np.array([1.0, 0.5]), TWO, gaussian(g, 500), coloured(g, 500, [1.0, 0.6, 0.2], TWO), 30.0
    ),
    "ARX 4, 600 samples, 20 %": lambda g: linear(
        np.array([1.0, 0.2]), FOUR, gaussian(g, 600), coloured(g, 600, [1.0], FOUR), 20.0
    ),
    "ball and beam, feedback": lambda g: ball_and_beam(g, 800, 1.0, 10.0),
    "slow, delay 15, level": lambda g: linear(
        np.array([0.03]), SLOW, prbs(g, 800, 25) + 3.0, gaussian(g, 800), 15.0, 15, 50.0
    ),
    "flexible link, oversampled": lambda g: linear(
        np.array([1e-3, 1e-3]), LINK, prbs(g, 3000, 30), gaussian(g, 3000), 10.0
    ),
    "five modes, 1500 samples": lambda g: linear(
        np.array([1.0, 0.3, -0.4, 0.2, 0.5]), MANY, gaussian(g, 1500), gaussian(g, 1500), 10.0
    ),
    "two tanks, 600 samples": lambda g: tank(g, 600, 5.0),
    "chirp, 1000 samples": lambda g: linear(
        np.array([1.0, 0.4]),
        FOUR,
        chirp(np.arange(1000.0), 0.002, 1000, 0.3),
        gaussian(g, 1000),
        10.0,
    ),
    "steps, 400 samples, 50 %": lambda g: linear(
        np.array([0.2, 0.1]), SLOW, step_levels(g, 400, 40), gaussian(g, 400), 50.0
    ),
    "dry friction, multisine": lambda g: friction(g, 1500, 0.3, 1.0),
    "impulsive disturbance": lambda g: impulsive(g, 800, FOUR, np.array([1.0, 0.5]), 0.03),
    "sensor outliers": lambda g: outlying(
        linear(np.array([1.0, 0.5]), FOUR, gaussian(g, 800), gaussian(g, 800), 5.0), g, 0.03
    ),
}

UNTOUCHED: dict[str, System] = {
    "OE 4, multisine, 40 %": lambda g: linear(
        np.array([0.5, -0.8, 0.6]),
        poles((0.93, 0.7), (0.97, 0.25)),
        np.tile(multisine(g, 250, 1, 80), 3),
        gaussian(g, 750),
        40.0,
    ),
    "BJ 2, slow noise, 50 %": lambda g: linear(
        np.array([1.0]),
        poles((0.85, 0.9)),
        prbs(g, 700, 4),
        coloured(g, 700, [1.0], [1.0, -0.97]),
        50.0,
        3,
    ),
    "ARMAX 3, 400 samples, 15 %": lambda g: linear(
        np.array([0.3, 0.2]),
        poles((0.8, 0.0), (0.9, 1.0)),
        gaussian(g, 400),
        coloured(g, 400, [1.0, -0.8], poles((0.8, 0.0), (0.9, 1.0))),
        15.0,
    ),
    "ARX 2, steps, 300 samples": lambda g: linear(
        np.array([0.4]),
        poles((0.92, 0.15)),
        step_levels(g, 300, 15),
        coloured(g, 300, [1.0], poles((0.92, 0.15))),
        10.0,
    ),
    "integrator under feedback": lambda g: ball_and_beam(g, 1000, 0.7, 30.0),
    "first order, delay 40": lambda g: linear(
        np.array([0.05]), poles((0.96, 0.0)), prbs(g, 1000, 60) + 8.0, gaussian(g, 1000), 10.0, 40
    ),
    "link, 5000 samples": lambda g: linear(
        np.array([2e-3]),
        poles((0.9985, 0.05), (0.995, 0.2)),
        coloured(g, 5000, [1.0], [1.0, -0.95]),
        gaussian(g, 5000),
        20.0,
    ),
    "four modes, coloured noise": lambda g: linear(
        np.array([0.4, -0.2, 0.7]),
        poles((0.99, 0.5), (0.98, 1.1), (0.99, 1.7), (0.96, 2.4)),
        prbs(g, 1200, 2),
        coloured(g, 1200, [1.0, 0.7], [1.0, -0.6]),
        20.0,
    ),
    "tank, other outflow": lambda g: tank(g, 1000, 10.0, 0.7),
    "chirp, lightly damped": lambda g: linear(
        np.array([1.0]),
        poles((0.985, 0.6)),
        chirp(np.arange(600.0), 0.01, 600, 0.25),
        gaussian(g, 600),
        20.0,
    ),
    "weak dry friction": lambda g: friction(g, 1200, 0.1, 3.0),
    "disturbance impulses, slow": lambda g: impulsive(
        g, 1000, poles((0.95, 0.2), (0.7, 0.0)), np.array([0.5]), 0.02
    ),
    "outliers, slow system": lambda g: outlying(
        linear(np.array([0.1]), SLOW, prbs(g, 600, 20), gaussian(g, 600), 10.0), g, 0.02
    ),
}


def arx(u: Array, y: Array, delay: int = 0) -> PolynomialModel:
    """ARX of equal orders by BIC."""
    best, found, top = np.inf, None, min(25, len(y) // 15)
    for n in range(1, top + 1):
        rows = np.column_stack(
            [-y[top - i : len(y) - i] for i in range(1, n + 1)]
            + [u[top - i : len(u) - i] for i in range(n + 1)]
            + [np.ones(len(y) - top)]
        )
        theta = np.linalg.lstsq(rows, y[top:], rcond=None)[0]
        e = y[top:] - rows @ theta
        bic = np.log(e @ e / len(e)) + len(theta) * np.log(len(e)) / len(e)
        if bic < best:
            a = np.concatenate([[1.0], theta[:n]])
            best, found = bic, _model(a, theta[n:-1].reshape(n + 1, -1).T, level=theta[-1])
    return found


def subspace(u: Array, y: Array) -> PolynomialModel:
    """A subspace denominator and a numerator by least squares, order by BIC of simulations."""
    best, found = np.inf, None
    inputs = u.reshape(len(y), -1).T
    v, z = u - u.mean(axis=0), y - y.mean()
    for n in range(1, min(13, len(y) // 30)):
        f = np.concatenate([[1.0], subspace_denominator(v, z, n)])
        f[1:] = reflect_into_disc(f[None, 1:], 0.99999)[0]
        columns = np.column_stack(
            [lfilter(np.eye(n + 1)[i], f, each) for each in inputs for i in range(n + 1)]
            + [lfilter(np.eye(n)[i], f, np.eye(len(y))[0]) for i in range(n)]
            + [np.ones(len(y))]
        )
        theta = np.linalg.lstsq(columns, y, rcond=1e-10)[0]
        e = y - columns @ theta
        bic = np.log(e @ e / len(e)) + len(theta) * np.log(len(e)) / len(e)
        if np.isfinite(bic) and bic < best:
            of_inputs = theta[: (n + 1) * len(inputs)].reshape(len(inputs), -1)
            best, found = bic, _model(f, of_inputs, level=theta[-1] * f.sum())
    return found


def regularised(u: Array, y: Array) -> PolynomialModel:
    """Finite impulse responses with the TC kernel, its parameters by marginal likelihood, which
    are those of all inputs in units of their standard deviations."""
    inputs = u.reshape(len(y), -1).T
    if not np.ptp(inputs, axis=1).all():  # an input that rests tells the level alone
        return _model(np.ones(1), np.zeros((len(inputs), 1)), level=float(y.mean()))
    n, m = min(120, len(y) // 4), len(inputs)
    scales = inputs.std(axis=1) / inputs[0].std()
    v, z = (inputs.T - inputs.mean(axis=1)).T / scales[:, None], (y - y.mean())[n:]
    rows = np.hstack([toeplitz(each[n:], each[n:0:-1]) for each in v])
    variance = max(np.var(z - rows @ np.linalg.lstsq(rows, z, rcond=None)[0]), 1e-9 * np.var(z))
    best, found = np.inf, None
    indices = np.arange(1, n + 1)
    gram = rows.T @ rows
    for decay in (0.6, 0.75, 0.85, 0.92, 0.96, 0.985):
        kernel = decay ** np.maximum.outer(indices, indices)
        root = block_diag(*[np.linalg.cholesky(kernel + 1e-12 * np.eye(n))] * m)
        for size in np.var(z) / np.var(v[0]) * np.logspace(-4, 1, 6):
            inner = variance / size * np.eye(n * m) + root.T @ gram @ root
            factor = cho_factor(inner)
            theta = root @ cho_solve(factor, root.T @ (rows.T @ z))
            e = z - rows @ theta
            likelihood = (
                (z @ e) / variance
                + 2.0 * np.sum(np.log(np.diag(factor[0])))
                + n * m * np.log(size / variance)
            )
            if likelihood < best:
                of_inputs = theta.reshape(m, n) / scales[:, None]
                level = y.mean() - inputs.mean(axis=1) @ of_inputs.sum(axis=1)
                best, found = likelihood, _model(np.ones(1), of_inputs, level=level)
    return found


def automatic(u: Array, y: Array) -> PolynomialModel:
    """The peer that simulates the second half best when fitted to the first."""
    half = len(y) // 2
    held = Segment(u[half:], y[half:])
    errors = []
    for peer in PEERS:
        model = peer(u[:half], y[:half])
        errors.append(_error(held.output, simulated(model, held, fitted_level=True)[:, 0]))
    return PEERS[int(np.argmin(errors))](u, y)


PEERS = (arx, subspace, regularised)


def _model(a: Array, b: Array, level: float) -> PolynomialModel:
    """A model with one row of coefficients of each input."""
    one = np.ones(1)
    return PolynomialModel(A=a, B=tuple(b), C=one, D=one, F=one, nk=0, level=float(level))


def _error(y: Array, computed: Array) -> float:
    with np.errstate(all="ignore"):
        value = 100.0 * np.linalg.norm(y - computed) / np.linalg.norm(y - y.mean())
    return float(min(value, 1000.0)) if np.isfinite(value) else 1000.0


def main() -> None:
    """Print one row for each system, and geometric means relative to the peers."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--set", choices=("development", "untouched"), default="development")
    parser.add_argument("--only", default="", help="systems whose name contains this")
    arguments = parser.parse_args()
    systems = DEVELOPMENT if arguments.set == "development" else UNTOUCHED
    names = ["arx", "subspace", "regularised", "automatic"]
    columns = ["system", "recipe", *names, "measured: recipe", "best peer", "model", "CPU s"]
    print(f"| {' | '.join(columns)} |")
    print("|---" * len(columns) + "|")
    ratios = []
    for number, (name, system) in enumerate(systems.items()):
        if arguments.only not in name:
            continue
        key = 0 if arguments.set == "development" else 1
        estimation, validation = (
            system(np.random.default_rng(np.random.SeedSequence([key, number, part])))
            for part in range(2)
        )
        begun = time.process_time()
        parts = [(each.input, each.measured) for each in (estimation, validation)]
        found = evopem.identify(*parts[0], 1.0, validation=parts[1], show_progress=False)
        spent = time.process_time() - begun
        # Of a lower rate at the times of the samples; the first tenth determines the state.
        table = pd.read_csv(found.files.simulation)
        times, own = table["time_s"], table.filter(like="recorded_simulated").iloc[:, 0]
        kept = own.notna()
        at = np.arange(len(validation.truth))[int(times[kept].iloc[0]) :]
        own = np.interp(at, times[kept], own[kept])
        truth, measured_samples = validation.truth[at], validation.measured[at]
        errors, measured = [_error(truth, own)], [_error(measured_samples, own)]
        held = Segment(validation.input, validation.measured)
        for peer in (*PEERS, automatic):
            model = peer(estimation.input, estimation.measured)
            by_peer = simulated(model, held, fitted_level=True)[at, 0]
            errors.append(_error(truth, by_peer))
            measured.append(_error(measured_samples, by_peer))
        ratios.append(
            (
                errors[0] / min(errors[1:4]),
                errors[0] / errors[4],
                measured[0] / min(measured[1:4]),
                measured[0] / measured[4],
            )
        )
        record = found.results.model
        print(
            f"| {name} | {' | '.join(f'{e:.2f}' for e in errors)} | {measured[0]:.2f} "
            f"| {min(measured[1:4]):.2f} | {record.text}, {record.level_of_simulation}, "
            f"{record.search.settings.objective}, {record.model.sampling_rate:g} Hz "
            f"| {spent:.0f} |",
            flush=True,
        )
    means = np.exp(np.mean(np.log(ratios), axis=0))
    print(
        f"\nGeometric means: against the truth {means[0]:.3f} of the best peer and {means[1]:.3f} "
        f"of the automatic one; against measured samples {means[2]:.3f} and {means[3]:.3f}."
    )


if __name__ == "__main__":
    main()
