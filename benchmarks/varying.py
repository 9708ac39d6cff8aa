"""Measure models with moving coefficients; docs/evidence/varying.md has the results.

    python benchmarks/varying.py {spectra,bands,choice} [--records 20]

``spectra``: a system of the kind of Poulimenos & Fassois (2006), three moving modes and a moving
noise numerator, TARMA(6,2); the aggregate error of the frozen spectrum beside short-time
AR and ARMA, recursive least squares with forgetting, and a smoothness-prior autoregression
(Kitagawa & Gersch 1985), each with the best setting of a grid in view of the truth.  ``bands``:
coverage of frozen frequencies and damping ratios by their 95 % bands, orders known, dimension by
BIC.  ``choice``: how often constant and moving systems are called moving, by the recipe.
"""

from __future__ import annotations

import argparse
import sys
import time
from itertools import product
from pathlib import Path

import numpy as np
from evidence import write_section
from scipy.signal import lfilter

sys.path.insert(0, str(Path(__file__).resolve().parent.parent / "workflow" / "scripts"))

from evopem import Orders, Recording, identify
from evopem.estimation.varying import Scheduled, VaryingProblem, fit_varying
from evopem.estimation.varying_choice import (
    autoregressions,
    choose_varying,
    race,
    undersmoothed,
)
from evopem.models.varying import all_free, delayed_inputs, filtered
from evopem.validation.held_out_tests import SIGNIFICANCE

RATE = 100.0
HALF_WIDTH = 1.96
GRID = np.linspace(0.5, 49.5, 99)
ABOUT_SPECTRA = """Three moving modes and a moving noise numerator, of the kind of Poulimenos and
Fassois (2006), whose own numbers are not repeated; 1200 samples. Sum of the absolute errors of the
frozen spectrum over its sum, with two standard errors. Short-time, recursive and smoothness-prior
estimates have the best of three to nine settings in view of the truth, functional series those of
BIC. Means are led by records with a pole close to the circle, whose peak is high.
"""
ABOUT_CHOICE = """A mode at 12 Hz in records of 500 and 1000 samples stays, or changes by a fifth: a
drift, two periods of a sine, a jump. By the whole recipe (for prediction, 100 evaluations,
structure given but for AR), with its own orders: "Constant in time" fails for its model, else there
is no moving model; BIC moves a term; "The machine changes" is said, as the moving model, chosen
among the best few without the samples that judge it, predicts them better. Without the test, tried
once at b2ee996b, none of 188 constant systems is said to change.
"""


def polynomial(frequencies, dampings):
    """Coefficients behind the leading 1 of poles at moments, (N, 2 modes)."""
    omega = 2.0 * np.pi * np.atleast_2d(frequencies) / RATE
    zeta = np.broadcast_to(dampings, omega.shape)
    product = np.ones((len(omega), 1))
    for w, z in zip(omega.T, zeta.T, strict=True):
        r, turned = np.exp(-z * w), w * np.sqrt(1.0 - z**2)
        section = np.column_stack([np.ones(len(w)), -2.0 * r * np.cos(turned), r**2])
        longer = np.zeros((len(product), product.shape[1] + 2))
        for k in range(3):
            longer[:, k : k + product.shape[1]] += section[:, [k]] * product
        product = longer
    return product[:, 1:]


def survey(samples, seed):
    """Output, and true A and C, of three moving modes."""
    x = np.linspace(0.0, 1.0, samples)[:, None]
    moving = np.hstack([8.0 + 3.0 * x, 20.0 + 3.0 * np.sin(2.0 * np.pi * x), 36.0 - 5.0 * x**2])
    a, c = polynomial(moving, [0.05, 0.04, 0.03]), polynomial(14.0 + 4.0 * x, [0.2])
    e = np.random.default_rng(np.random.SeedSequence(7, spawn_key=(seed,))).normal(size=samples)
    bounds = np.array([0, samples])
    past = [np.r_[np.zeros(k), e[:-k]] for k in (1, 2)]
    y = filtered((e + c[:, 0] * past[0] + c[:, 1] * past[1])[:, None], a, bounds)[:, 0]
    return y, a, c


def spectrum(a, c, variance):
    """Frozen spectra, (N, frequencies)."""
    turns = np.exp(-2j * np.pi * GRID / RATE)
    above = 1.0 + sum(c[:, [k]] * turns ** (k + 1) for k in range(c.shape[1]))
    below = 1.0 + sum(a[:, [k]] * turns ** (k + 1) for k in range(a.shape[1]))
    return np.reshape(variance, (-1, 1)) * np.abs(above / below) ** 2


def regressed(y, errors, order, nc):
    """AR, or ARMA with errors that are known, by least squares: coefficients, and what is left."""
    first = max(order, nc)
    past = [-y[first - k : len(y) - k] for k in range(1, order + 1)]
    past += [errors[first - k : len(y) - k] for k in range(1, nc + 1)]
    columns = np.column_stack(past)
    theta = np.linalg.lstsq(columns, y[first:], None)[0]
    return theta, np.r_[np.zeros(first), y[first:] - columns @ theta]


def short_time(y, order, width, nc=0):
    """AR or ARMA (by two stages) of windows around each moment, every tenth."""
    rows, places = [], np.arange(0, len(y), 10)
    for place in places:
        first = min(max(place - width // 2, 0), len(y) - width)
        part = y[first : first + width]
        errors = regressed(part, part, 2 * order + nc, 0)[1] if nc else part
        theta, left = regressed(part, errors, order, nc)
        rows.append(np.r_[theta, np.mean(left[order:] ** 2)])
    rows = np.array(rows)
    at = np.arange(len(y))
    return np.column_stack([np.interp(at, places, column) for column in rows.T])


def state(y, order, drift, forgetting):
    """Kalman's filter of coefficients that walk, or of recursive least squares; then smoothed."""
    theta, P = np.zeros(order), 1e3 * np.eye(order)
    means, covariances, before, variance = [], [], [], []
    for t in range(len(y)):
        P = P / forgetting + drift * np.eye(order)
        phi = np.array([-y[t - k] if t >= k else 0.0 for k in range(1, order + 1)])
        gain = P @ phi / (1.0 + phi @ P @ phi)
        error = y[t] - phi @ theta
        before.append((theta, P))
        theta, P = theta + gain * error, P - np.outer(gain, phi @ P)
        means.append(theta)
        covariances.append(P)
        variance.append(error * (y[t] - phi @ theta))
    if drift:
        for t in range(len(y) - 2, -1, -1):
            J = np.linalg.solve(before[t + 1][1], covariances[t]).T
            means[t] = means[t] + J @ (means[t + 1] - before[t + 1][0])
    mean = np.array(means)
    past = np.column_stack([np.r_[np.zeros(k), -y[:-k]] for k in range(1, order + 1)])
    left = (y - np.sum(past * mean, axis=1)) ** 2 if drift else np.array(variance)
    window = np.ones(201)
    local = np.convolve(left, window, "same") / np.convolve(np.ones(len(y)), window, "same")
    return np.column_stack([mean, np.maximum(local, 1e-6)])


def spectra(records, _kinds, samples=1200):
    errors, seconds = {}, {}
    for number in range(records):
        y, a, c = survey(samples, number)
        truth = spectrum(a, c, 1.0)
        scheduled = Scheduled.of(Recording(np.zeros((samples, 0)), y, RATE))
        times = scheduled.schedule

        def note(name, began, estimate, truth=truth):
            seconds[name] = seconds.get(name, 0.0) + time.process_time() - began
            errors.setdefault(name, []).append(np.abs(estimate - truth).sum() / truth.sum())

        began = time.process_time()
        chosen = autoregressions(scheduled, 12, ())[0]
        tar = fit_varying(scheduled, chosen.orders, chosen.basis).model
        theta = tar.coefficients(times)
        of_tar = spectrum(
            theta[:, tar.rows["a"]], np.zeros((samples, 0)), tar.noise_variance(times)
        )
        note("FS-TAR", began, of_tar)
        began, best = time.process_time(), None
        for dimension in (4, 5, 6, 8):
            basis = scheduled.basis(chosen.basis.kind, dimension)
            fit = by_descent(scheduled, Orders(na=6, nc=2), basis)
            best = fit if best is None or fit.bic < best.bic else best
        theta, rows = best.model.coefficients(times), best.model.rows
        of_tarma = spectrum(
            theta[:, rows["a"]], theta[:, rows["c"]], best.model.noise_variance(times)
        )
        note("FS-TARMA, orders known", began, of_tarma)
        began = time.process_time()
        chosen = choose_varying(scheduled, race(scheduled, 10)).model
        theta, rows = chosen.coefficients(times), chosen.rows
        of_recipe = spectrum(theta[:, rows["a"]], theta[:, rows["c"]], chosen.noise_variance(times))
        note("FS, all by BIC as in the recipe", began, of_recipe)
        for name, methods in (
            ("short-time AR", [(short_time, (n, w)) for n in (6, 8, 10) for w in (150, 250, 400)]),
            ("short-time ARMA, orders known", [(short_time, (6, w, 2)) for w in (150, 250, 400)]),
            (
                "RLS with forgetting",
                [(state, (n, 0.0, f)) for n in (8, 10) for f in (0.98, 0.99, 0.995)],
            ),
            (
                "smoothness-prior AR",
                [(state, (n, d, 1.0)) for n in (8, 10) for d in (1e-6, 1e-5, 1e-4)],
            ),
        ):
            began, tried = time.process_time(), []
            for method, arguments in methods:
                theta = method(y, *arguments)
                n = arguments[0]
                tried.append(spectrum(theta[:, :n], theta[:, n:-1], theta[:, -1]))
            note(name, began, min(tried, key=lambda e: np.abs(e - truth).sum()))
        print(number, {name: round(values[-1], 2) for name, values in errors.items()}, flush=True)
    rows = []
    for name, values in errors.items():
        spread = np.std(values) / len(values) ** 0.5
        share = f"{100 * np.mean(values):.1f} ± {200 * spread:.1f}"
        took = f"{seconds[name] / records:.1f}"
        rows.append((name, share, f"{100 * np.median(values):.1f}", took))
    command = f"python benchmarks/varying.py spectra --records {records}"
    columns = "method", "error (%)", "median (%)", "processor time (s)"
    write_section("varying", "Frozen spectra", ABOUT_SPECTRA, command, columns, rows)


KINDS = ("AR", "ARX", "ARMAX", "OE", "BJ")


COURSES = {
    "constant": np.zeros_like,
    "drift": lambda x: x - 0.5,
    "periodic": lambda x: 0.5 * np.sin(4.0 * np.pi * x),
    "jump": lambda x: (x > 0.6) - 0.5,
}
# Lengths of records in turn; constant ones for each one that changes.
LENGTHS, POWER = (500, 1000), 10


def system(kind, samples, seed, change, course="drift"):
    """A mode of 12 Hz that changes by a share, with an input but for AR; frequencies (N,)."""
    generator = np.random.default_rng(np.random.SeedSequence(11, spawn_key=(seed,)))
    x, bounds = np.linspace(0.0, 1.0, samples), np.array([0, samples])
    f = 12.0 * (1.0 + change * COURSES[course](x))
    a, u = polynomial(f[:, None], [0.03]), generator.normal(size=(samples, 1))
    e = 0.3 * generator.normal(size=samples)
    forced = delayed_inputs(Orders(na=2, nb=2, nk=1), u, bounds) @ [1.0, 0.5]
    added = {"OE": e, "BJ": lfilter([1.0], [1.0, -0.8], e)}.get(kind, 0.0)
    drive = {"AR": e, "ARX": forced + e, "OE": forced, "BJ": forced}.get(kind)
    if drive is None:
        drive = forced + e + 0.6 * np.r_[0.0, e[:-1]]
    y = filtered(drive[:, None], a, bounds)[:, 0] + added
    return Scheduled.of(Recording(u[:, : kind != "AR"], y, RATE)), f


ORDERS = {
    "AR": Orders(na=2),
    "ARX": Orders(na=2, nb=2, nk=1),
    "ARMAX": Orders(na=2, nb=2, nc=1, nk=1),
    "OE": Orders("oe", nb=2, nf=2, nk=1),
}


def by_descent(scheduled, orders, basis):
    """From the estimate by two stages, without a search."""
    problem = VaryingProblem(scheduled, orders, basis, all_free(orders, basis))
    starts = [problem.start()] if orders.nc or any(orders.nf) else []
    return fit_varying(scheduled, orders, basis, starts=starts)


def bands(records, kinds, samples=1000):
    for kind in filter(ORDERS.get, kinds):
        covered = []
        for number in range(records):
            scheduled, f = system(kind, samples, number, 0.3)
            fits = [
                by_descent(scheduled, ORDERS[kind], scheduled.basis("legendre", n))
                for n in (2, 3, 4)
            ]
            best = min(fits, key=lambda fit: fit.bic)
            model = undersmoothed(scheduled, best).model
            for place in np.linspace(0, samples - 1, 11).astype(int):
                modes = model.frozen(scheduled.schedule[place]).modes()
                mode = min(modes, key=lambda m: abs(m.frequency_hz - f[place]), default=None)
                if mode is None:
                    covered.append((False, False))
                    continue
                hz = abs(mode.frequency_hz - f[place]) <= HALF_WIDTH * mode.frequency_se_hz
                damping = abs(mode.damping_ratio - 0.03) <= HALF_WIDTH * mode.damping_se
                covered.append((hz, damping))
        hz, damping = 100.0 * np.mean(covered, axis=0)
        print(f"| {kind} | {records} | {hz:.1f} | {damping:.1f} |", flush=True)


def of_recipe(kind, scheduled):
    """Whether the recipe's test finds a change, BIC moves a term, and a report says so."""
    given = {} if kind == "AR" else {"structure": kind.lower()}
    data = scheduled.data
    u = data.inputs if data.inputs.shape[1] else None
    given |= {"search": {"evaluations": 100}, "purpose": "prediction", "show_progress": False}
    varying = identify(u, data.output, RATE, **given).results.varying
    moves = varying.moves
    fails = varying.tests.constant.p_value < SIGNIFICANCE
    return fails, moves is not None, moves is not None and moves.is_better


def choice(records, kinds):
    """The recipe on constant systems, and on changes of a fifth in every tenth as many."""
    counts = {}
    for number, course, kind in product(range(records), COURSES, kinds):
        if course != "constant" and number >= max(records // POWER, 1):
            continue
        samples = LENGTHS[number % len(LENGTHS)]
        change = 0.0 if course == "constant" else 0.2
        scheduled, _ = system(kind, samples, 2000 + number, change, course)
        told = 1, *of_recipe(kind, scheduled)
        counts[course, kind] = np.add(counts.get((course, kind), 0), told)
        print(course, kind, samples, told, flush=True)
    write_choice(counts, records)


def write_choice(counts, records):
    """The section of the evidence page, with the sums over structures."""
    sums = {}
    for (course, _), told in counts.items():
        sums[course, "all"] = np.add(sums.get((course, "all"), 0), told)
    rows = [(*of, *map(str, told)) for of, told in sorted({**counts, **sums}.items())]
    columns = "course", "structure", "records", "test fails", "BIC moves a term", "said to change"
    command = f"python benchmarks/varying.py choice --records {records}"
    write_section("varying", "False alarms and power", ABOUT_CHOICE, command, columns, rows)


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("part", choices=("spectra", "bands", "choice"))
    parser.add_argument("--records", type=int, default=20)
    parser.add_argument("--kinds", nargs="+", choices=KINDS, default=KINDS)
    given = parser.parse_args()
    {"spectra": spectra, "bands": bands, "choice": choice}[given.part](given.records, given.kinds)
