"""Does any other method end lower than the search?  Writes docs/evidence/search.md.

    python benchmarks/lowest_objective.py [--records 20] [--processes 2] [--recordings FOLDER]

1. At the true orders of the ARMAX(7,6,7,3) truth: the search against 200 starts of SciPy's SLSQP,
   which moves in reflection coordinates, where the stability region is a box.
2. At ARMAX(14,14,14,3), where the objective has many minima: the search against SciPy's BFGS
   and Levenberg-Marquardt from the chapter's random starts, at equal evaluations and at equal time.
3. The same on real recordings, where FOLDER holds them.
4. At the true orders of systems sampled 50 to 2000 times a mode: the search against MINPACK's
   Levenberg-Marquardt from the truth and from points next to it.
"""

from __future__ import annotations

import argparse
import sys
import time
from collections.abc import Callable
from concurrent.futures import Executor, ProcessPoolExecutor
from functools import reduce
from itertools import product
from pathlib import Path

import numpy as np
from evidence import write_section
from numpy.typing import NDArray
from scipy.optimize import least_squares, minimize
from scipy.signal import cont2discrete, lfilter
from threadpoolctl import threadpool_limits

ROOT = Path(__file__).resolve().parent.parent
sys.path.insert(0, str(ROOT / "workflow" / "scripts"))

from filtered_residuals import FilteredResiduals  # noqa: E402

from evopem.config.settings import ScoringWindow, SearchSettings  # noqa: E402
from evopem.estimation.pem.polynomial_errors import PolynomialErrors  # noqa: E402
from evopem.estimation.prediction_errors import (  # noqa: E402
    default_window,
    scaled_errors,
)
from evopem.estimation.prediction_errors import prediction_errors as errors_of  # noqa: E402
from evopem.estimation.search.certificate import is_certified  # noqa: E402
from evopem.estimation.search.global_search import global_search  # noqa: E402
from evopem.estimation.search.polynomial_problem import PolynomialProblem  # noqa: E402
from evopem.models.orders import Orders, armax_orders  # noqa: E402
from evopem.models.polynomial import PolynomialModel  # noqa: E402
from evopem.signals.recording import Recording, Segment  # noqa: E402
from evopem.synthesis import armax  # noqa: E402

Array = NDArray[np.float64]

TRUE_ORDERS = armax_orders(7, 6, 7, 3)
LARGE_ORDERS = armax_orders(14, 14, 14, 3)
LENGTHS = (4500, 500)
NOISES = (0.1, 0.5)
RADIUS = 0.9999
STARTS = 200
N_INITIAL_DISCARD = 20
# The default search, and the evaluations with which an unconfirmed one is repeated.
DEFAULT, MORE = SearchSettings(), SearchSettings(evaluations=100_000)


def prediction_errors(record: Recording, orders: Orders, objective: str) -> PolynomialErrors:
    first = max(orders.first_residual, 3)
    y, u = record.output - record.output.mean(), record.input - record.input.mean()
    scored = first + max(N_INITIAL_DISCARD, orders.nc)
    return PolynomialErrors(
        [Segment(u / np.std(u), y / np.std(y))],
        *(orders, objective, RADIUS, RADIUS, False, ScoringWindow(first, scored)),
    )


def searched(errors: PolynomialErrors, settings: SearchSettings) -> tuple[float, int, float]:
    """Best value, evaluations and processor time of one search."""
    began = time.process_time()
    result = global_search(PolynomialProblem(errors), settings, np.random.default_rng(1))
    return result.value, result.diagnostics.evaluations, time.process_time() - began


def from_reflections(reflections: Array) -> tuple[Array, Array]:
    """Coefficients of the monic polynomial with these reflection coefficients, and d/d k."""
    m = len(reflections)
    a, slopes = np.zeros(m), np.zeros((m, m))
    for order, k in enumerate(reflections, start=1):
        head = a[: order - 1].copy()
        old = slopes[: order - 1].copy()
        a[: order - 1] = head + k * head[::-1]
        slopes[: order - 1] = old + k * old[::-1]
        slopes[: order - 1, order - 1] += head[::-1]
        a[order - 1] = k
        slopes[order - 1, order - 1] = 1.0
    powers = RADIUS ** np.arange(1, m + 1)
    return a * powers, slopes * powers[:, None]


def to_reflections(coefficients: Array) -> Array:
    """Reflection coefficients of a monic polynomial, a step inside the box."""
    x = coefficients / RADIUS ** np.arange(1, len(coefficients) + 1)
    reflections = np.zeros(len(x))
    for order in range(len(x), 0, -1):
        k = np.clip(x[order - 1], -1 + 1e-9, 1 - 1e-9)
        reflections[order - 1] = k
        x = (x[: order - 1] - k * x[: order - 1][::-1]) / (1.0 - k * k)
    return reflections


def sequential_quadratic_from(errors: PolynomialErrors, start: Array) -> float:
    """SciPy's SLSQP in reflection coordinates, in which the stability region is a box."""
    o = errors.orders
    parts = (slice(0, o.na), slice(o.na + o.single.nb, o.parameters))
    x = start.copy()
    bounds = [(-np.inf, np.inf)] * len(x)
    for part in parts:
        x[part] = to_reflections(start[part])
        bounds[part] = [(-1.0 + 1e-9, 1.0 - 1e-9)] * (part.stop - part.start)
    # Solver and stopping rule are made for values and coordinates of order one.
    scale = float(errors.values(start[None, :])[0])
    none = np.zeros(1)

    def at(x: Array) -> tuple[Array, Array]:
        point, slopes = x.copy(), np.eye(len(x))
        for part in parts:
            point[part], slopes[part, part] = from_reflections(x[part])
        return point, slopes

    def value(x: Array) -> tuple[float, Array]:
        point, slopes = at(x)
        v, g = errors.values_and_gradients(point[None, :], none, none)
        if not np.isfinite(v[0]):
            return 1e6, np.zeros(len(x))
        return float(v[0]) / scale, slopes.T @ g[0] / scale

    found = minimize(
        value,
        x,
        jac=True,
        method="SLSQP",
        bounds=bounds,
        options={"maxiter": 1000, "ftol": 1e-13},
    )
    return float(errors.values(at(found.x)[0][None, :])[0])


def bfgs_from(errors: PolynomialErrors, start: Array) -> tuple[float, int]:
    """SciPy's BFGS on the exact gradient; infinite outside the stability region."""
    spread = np.array([0.0])
    none = np.zeros(1)
    if errors.objective == "absolute":
        spread = 0.01 * errors.mean_absolute_residuals(errors.values(start[None, :]))

    def value(x: Array) -> tuple[float, Array]:
        v, g = errors.values_and_gradients(x[None, :], spread, none)
        return float(v[0]), g[0]

    with np.errstate(all="ignore"):
        found = minimize(value, start, jac=True, method="BFGS", options={"maxiter": 400})
    return float(errors.values(found.x[None, :])[0]), 2 * found.nfev


def levenberg_marquardt_from(errors: PolynomialErrors, start: Array) -> tuple[float, int]:
    """MINPACK's Levenberg-Marquardt; a wall of huge residuals outside the stability region."""
    filtered = FilteredResiduals(errors)
    wall = np.full(len(filtered.residuals(start)), 1e3 * float(np.std(errors.output)))

    def residuals(x: Array) -> Array:
        return filtered.residuals(x) if errors.feasible(x[None, :])[0] else wall

    found = least_squares(
        residuals, start, filtered.jacobian, method="lm", x_scale="jac", max_nfev=200
    )
    # A Jacobian is worth its columns in evaluations by differences; by filters it counts as two.
    return float(errors.values(found.x[None, :])[0]), found.nfev + 2 * (found.njev or 0)


def multistart(
    errors: PolynomialErrors,
    local: Callable[[PolynomialErrors, Array], tuple[float, int]],
    evaluations: int,
) -> float:
    """Best value of repeated starts within the evaluations."""
    generator = np.random.default_rng(2)
    problem = PolynomialProblem(errors)
    spent, best = 0, np.inf
    while spent < evaluations:
        value, used = local(errors, problem.draw(2, generator)[0][1])
        best = min(best, value)
        spent += used
    return best


def true_orders(case: tuple[int, float, int]) -> float:
    """Relative distance of the search to the best of 200 starts."""
    samples, noise, seed = case
    with threadpool_limits(limits=1):
        errors = prediction_errors(armax(seed, samples, noise=noise)[0], TRUE_ORDERS, "quadratic")
        starts, _ = PolynomialProblem(errors).draw(STARTS, np.random.default_rng(seed))
        best = min(sequential_quadratic_from(errors, start) for start in starts)
        return searched(errors, DEFAULT)[0] / best - 1.0


METHODS = ("search", "BFGS", "LM")


def large_orders(record: Recording, orders: Orders, objective: str) -> tuple[list[float], float]:
    """Best value of each of :data:`METHODS`, and the seconds that the search took."""
    with threadpool_limits(limits=1):
        errors = prediction_errors(record, orders, objective)
        searched(errors, SearchSettings(evaluations=1))  # compile
        lowest, spent, seconds = searched(errors, MORE)
        values = [lowest, multistart(errors, bfgs_from, spent)]
        absolute = objective == "absolute"  # no sum of squares
        values += [
            np.nan if absolute else multistart(errors, levenberg_marquardt_from, spent),
        ]
    return values, seconds


def synthetic_large(case: tuple[int, float, int, str]) -> tuple[list[float], float]:
    samples, noise, seed, objective = case
    return large_orders(armax(seed, samples, noise=noise)[0], LARGE_ORDERS, objective)


def recordings(folder: Path) -> list[tuple[str, Recording, Orders]]:
    """The real recordings at hand: DaISy's robot arm, FdiTools' motor bench."""
    from scipy.io import loadmat

    found = []
    arm = folder / "daisy" / "robot_arm.dat"
    if arm.exists():
        data = np.loadtxt(arm)[:800]
        found.append(
            ("robot arm", Recording(data[:, 0], data[:, 1], 125.0), armax_orders(6, 6, 6, 0))
        )
    bench = folder / "motor_bench" / "MultisineTypeA.mat"
    if bench.exists():
        mat = loadmat(bench)
        u, y = (np.ravel(mat[name])[:7500] for name in ("iq_adx", "omega_may"))
        found.append(("motor bench", Recording(u, y, 2500.0), armax_orders(10, 10, 10, 1)))
    return found


def gap_row(label: str, results: list[tuple[list[float], float]]) -> list[str]:
    """How often each method found the best value of any, and its median excess."""
    values = np.array([result for result, _ in results])
    gaps = values / np.nanmin(values, axis=1, keepdims=True) - 1.0
    seconds = np.mean([taken for _, taken in results])
    cells = [
        "–"
        if np.isnan(column).all()
        else f"{np.sum(column <= 1e-6)}/{len(column)}, {100 * np.median(column):.3g}"
        for column in gaps.T
    ]
    row = [label, *cells, f"{seconds:.1f}"]
    print(row, flush=True)
    return row


FINE = ("oe", "bj", "armax", "oe", "arx")
FINE_INPUTS = ("white", "pseudo-random binary", "coloured")
LARGEST_FINE = {"oe": 8, "bj": 8, "armax": 5, "arx": 3}
# Least A(1) or F(1): coefficients of less hold too few digits of the poles.
LEAST_AT_ONE, WARM_UP = 1e-11, 4000
# Starts next to the truth, and how far their poles are from it, relative in s.
NEIGHBOURS, AWAY = 4, 0.02


def sampled(numerator: list[float], denominator: list[float]) -> tuple[Array, Array]:
    b, a, _ = cont2discrete((numerator, denominator), 1.0)
    return np.ravel(b), np.ravel(a)


def fine_sections(
    structure: str, generator: np.random.Generator
) -> tuple[float, list[Array], list[Array]]:
    """Samples of the fastest mode a period, and numerators and denominators of all modes."""
    while True:
        order = int(generator.integers(2, LARGEST_FINE[structure] + 1))
        ratio = 50.0 * 10.0 ** generator.random()
        w = 2.0 * np.pi / (ratio * 4.0 ** generator.random(order // 2))
        z = 0.02 * 25.0 ** generator.random(order // 2)
        sections = [sampled([a * a], [1.0, 2.0 * d * a, a * a]) for a, d in zip(w, z, strict=True)]
        sections += [sampled([a], [1.0, a]) for a in [2.0 * np.pi / ratio] * (order % 2)]
        if np.prod([a.sum() for _, a in sections]) >= LEAST_AT_ONE:
            return ratio, [b for b, _ in sections], [a for _, a in sections]


def fine_noise(
    structure: str, sections: list[Array], generator: np.random.Generator
) -> tuple[Array, Array]:
    """C and D, or of ARMAX models C with more damped roots near those of A."""
    if structure == "bj":
        first, second = (np.poly(generator.uniform(-0.8, 0.9, 2)) for _ in "cd")
        return np.asarray(first, dtype=float), np.asarray(second, dtype=float)
    c = [np.ones(1)]
    for a in sections if structure == "armax" else ():
        w = float(np.abs(np.log(np.roots(a).astype(complex)[0]))) * generator.uniform(0.7, 2.0)
        damped = [1.0, 2.0 * generator.uniform(0.4, 1.0) * w, w * w] if len(a) == 3 else [1.0, w]
        c.append(sampled([1.0], damped)[1])
    return reduce(np.convolve, c), np.ones(1)


def fine_input(kind: str, ratio: float, samples: int, generator: np.random.Generator) -> Array:
    u = generator.standard_normal(samples)
    if kind == "coloured":
        return np.asarray(lfilter([1.0], [1.0, -np.exp(-4.0 * np.pi / ratio)], u))
    return u if kind == "white" else np.sign(np.repeat(u, max(int(ratio / 8.0), 1))[:samples])


def finely_sampled(index: int) -> tuple[str, PolynomialProblem, Array]:
    """Structure, problem and true point of a system of 2 to 8 poles; 2000 to 10 000 samples."""
    generator = np.random.default_rng([2031, index])
    structure, kind = FINE[index % 5], FINE_INPUTS[index // 5 % 3]
    ratio, numerators, denominators = fine_sections(structure, generator)
    samples = int(2000 * 5.0 ** generator.random())
    gains = generator.choice([-1.0, 1.0], len(numerators)) * generator.uniform(
        0.3, 1.0, len(numerators)
    )
    numerators = [gain * b for gain, b in zip(gains, numerators, strict=True)]
    u = fine_input(kind, ratio, samples + WARM_UP, generator)
    pairs = list(zip(numerators, denominators, strict=True))
    v = generator.standard_normal(samples + WARM_UP)
    c, d = fine_noise(structure, denominators, generator)
    v = lfilter(c, d, v)
    for a in denominators if structure in ("armax", "arx") else ():
        v = lfilter([1.0], a, v)
    clean = sum(lfilter(b, a, u) for b, a in pairs)
    noise = 0.02 * 15.0 ** generator.random() * np.std(clean[WARM_UP:]) / np.std(v[WARM_UP:])
    a = reduce(np.convolve, denominators)
    others = [
        reduce(np.convolve, [x for j, x in enumerate(denominators) if j != i], np.ones(1))
        for i in range(len(pairs))
    ]
    b = np.sum([np.convolve(*each) for each in zip(numerators, others, strict=True)], axis=0)[1:]
    one = np.ones(1)
    of_a, of_f = (a, one) if structure in ("armax", "arx") else (one, a)
    truth = PolynomialModel(of_a, b, c, d, of_f, 1, structure=structure)
    record = Recording(u[WARM_UP:], (clean + noise * v)[WARM_UP:], 1.0)
    orders, settings = truth.orders, SearchSettings(objective="quadratic")
    errors = errors_of(record, orders, settings, default_window(orders, settings), False)
    problem = PolynomialProblem(scaled_errors(errors)[0])
    return structure, problem, problem.adapted(truth)[0]


def next_to_truth(
    problem: PolynomialProblem, truth: Array, generator: np.random.Generator
) -> Array:
    """The true point and some with poles moved, B and the states by least squares, (M, n)."""
    points = np.repeat(truth[None, :], NEIGHBOURS + 1, axis=0)
    for name, part in problem.errors.polynomials:
        for point in points[1:] if name in "af" else ():
            s = np.log(np.roots(np.append(1.0, point[part])).astype(complex))
            s[s.imag > 0.0] *= np.exp(AWAY * generator.standard_normal(np.sum(s.imag > 0.0)))
            s[s.imag < 0.0] = s[s.imag > 0.0].conj()
            point[part] = np.real(np.poly(np.exp(s)))[1:]
    return problem.completed(points)[0]


def marquardt_from(errors: PolynomialErrors, start: Array) -> float:
    """MINPACK's Levenberg-Marquardt of any structure, by decompositions of the derivatives."""
    weights = np.sqrt(errors.state_weights() / errors.loss_factor)
    rows = np.diag(weights)[weights > 0.0]
    wall = np.full(errors.scored_samples + len(rows), 1e3)

    def residuals(x: Array) -> Array:
        inside = errors.feasible(x[None, :])[0]
        return np.concatenate([errors.residuals(x), rows @ x]) if inside else wall

    def jacobian(x: Array) -> Array:
        return np.concatenate([errors.jacobian(x), rows])

    with np.errstate(all="ignore"):
        found = least_squares(
            residuals, start, jacobian, method="lm", x_scale="jac", max_nfev=100, ftol=1e-12
        )
    return float(errors.values(found.x[None, :])[0])


def fine_search(index: int) -> tuple[str, float, bool, float]:
    """Structure, relative distance of the search to the best of both, certificate, seconds."""
    with threadpool_limits(limits=1):
        structure, problem, truth = finely_sampled(index)
        began = time.process_time()
        found = global_search(problem, SearchSettings(), np.random.default_rng(1))
        seconds = time.process_time() - began
        starts = next_to_truth(problem, truth, np.random.default_rng(index))
        finite = starts[np.isfinite(problem.values(starts))]
        again = global_search(problem, SearchSettings(), np.random.default_rng(2)).value
        others = [marquardt_from(problem.errors, start) for start in finite]
        best = min(found.value, again, *others)
    result = structure, found.value / best - 1.0, is_certified(found.diagnostics), seconds
    print(index, *result, flush=True)
    return result


def write_fine(pool: Executor, problems: int) -> None:
    results, rows = list(pool.map(fine_search, range(problems))), []
    for structure in dict.fromkeys(FINE):
        _, excess, certified, seconds = zip(*(r for r in results if r[0] == structure), strict=True)
        above = np.array(excess)
        wrong = np.sum(np.array(certified) & (above > 1e-4))
        cells = f"{np.sum(above <= 1e-6)}, {np.sum(above <= 1e-4)}", f"{above.max():.1e}"
        found = f"{sum(certified)}, {wrong}", f"{np.mean(seconds):.1f}"
        rows.append([structure.upper(), str(len(above)), *cells, *found])
    write_section(
        "search",
        "Finely sampled systems",
        f"{problems} systems of 2 to 8 poles at true orders, 50 to 2000 samples a period, white, "
        "binary and coloured inputs, 2000 to\n10 000 samples, noise of 2 to 30 %: the default "
        "search above the best of itself, another seed, and MINPACK's\nLevenberg-Marquardt from "
        f"the truth and from {NEIGHBOURS} points next to it, relative.",
        "benchmarks/lowest_objective.py",
        ("structure", "problems", "within 10⁻⁶, 10⁻⁴", "most", "certified, wrong ones", "s"),
        rows,
    )


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--records", type=int, default=20)
    parser.add_argument("--large-records", type=int, default=10)
    parser.add_argument("--fine-records", type=int, default=60)
    parser.add_argument("--processes", type=int, default=2)
    parser.add_argument("--recordings", type=Path)
    arguments = parser.parse_args()
    with ProcessPoolExecutor(arguments.processes) as pool:
        write_true_orders(pool, arguments.records)
        write_large_orders(pool, arguments.large_records, arguments.recordings)
        write_fine(pool, arguments.fine_records)


def write_true_orders(pool: Executor, records: int) -> None:
    columns, cells = [], []
    for samples, noise in product(LENGTHS, NOISES):
        cases = [(samples, noise, seed) for seed in range(1, records + 1)]
        gaps = np.array(list(pool.map(true_orders, cases)))
        columns.append(f"{samples}, {noise}")
        cells.append(f"{np.sum(gaps <= 1e-6)}, {gaps.max():.1e}")
        print(columns[-1], cells[-1], flush=True)
    write_section(
        "search",
        "True orders",
        f"The default search above the best of {STARTS} starts of SciPy's SLSQP, relative; "
        f"ARMAX(7,6,7,3), quadratic objective: within 10⁻⁶ in how many of {records}\nrecords, and "
        "the largest difference, by samples and noise.",
        "benchmarks/lowest_objective.py",
        columns,
        [cells],
    )


def write_large_orders(pool: Executor, records: int, folder: Path | None) -> None:
    rows = []
    for samples, objective in ((4500, "quadratic"), (4500, "absolute"), (500, "quadratic")):
        seeds = range(1, records + 1)
        cases = [(samples, noise, seed, objective) for noise in NOISES for seed in seeds]
        rows.append(gap_row(f"{samples}, {objective}", list(pool.map(synthetic_large, cases))))
    for name, record, orders in recordings(folder) if folder else []:
        for objective in ("quadratic", "absolute"):
            run = pool.submit(large_orders, record, orders, objective)
            rows.append(gap_row(f"{name} {orders}, {objective}", [run.result()]))
    write_section(
        "search",
        "Large orders",
        f"ARMAX(14,14,14,3), {len(NOISES) * records} records a row, and recordings; searches of "
        "100 000 evaluations, \nand multi-start BFGS and "
        "Levenberg-Marquardt (LM) with as many evaluations. Cells: how often within 10⁻⁶ of the "
        "best value that\nany of them found, and the median excess over it, percent.",
        "benchmarks/lowest_objective.py",
        ("problem", *METHODS, "s"),
        rows,
    )


if __name__ == "__main__":
    main()
