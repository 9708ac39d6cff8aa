"""How fast: ratios against named alternatives in one run; writes docs/evidence/speed.md.

    python benchmarks/speed.py        (make bench)

Each row compares two things on the same record, one after the other and in turns, so that what
else the machine does affects both.  The processor time of this process is what counts.
"""

from __future__ import annotations

import csv
import os
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
from evidence import write_section
from numpy.typing import NDArray
from scipy.optimize import least_squares
from scipy.signal import lfilter
from threadpoolctl import threadpool_limits

ROOT = Path(__file__).resolve().parent.parent
SCRIPTS = ROOT / "workflow" / "scripts"
sys.path.insert(0, str(SCRIPTS))

from filtered_residuals import FilteredResiduals  # noqa: E402
from speed_of_channels import write_several_channels  # noqa: E402

from evopem.config.defaults import complete  # noqa: E402
from evopem.config.order_grid import (  # noqa: E402
    DELAY_REFINED_IN,
    candidate_orders,
    phases_of_dataset,
    scoring_window,
)
from evopem.config.settings import ScoringWindow, SearchSettings  # noqa: E402
from evopem.estimation.order_candidate import Candidate, first_pass  # noqa: E402
from evopem.estimation.order_selection import (  # noqa: E402
    OrderSearch,
    estimate_candidates,
    select_candidate,
)
from evopem.estimation.pem.kernels.simd import LANES  # noqa: E402
from evopem.estimation.pem.polynomial_errors import PolynomialErrors  # noqa: E402
from evopem.estimation.search.global_search import global_search  # noqa: E402
from evopem.estimation.search.polynomial_problem import PolynomialProblem  # noqa: E402
from evopem.models.orders import Orders, armax_orders, orders_of  # noqa: E402
from evopem.notebook.estimate import estimate  # noqa: E402
from evopem.synthesis import armax  # noqa: E402

Array = NDArray[np.float64]

HISTORY = ROOT / "docs" / "evidence" / "speed_history.csv"
ORDERS = armax_orders(7, 6, 7, 3)
SAMPLES = 4500
RECORDS = (1, 2, 3)
# Times that local runs and searches, which take hundredths of a second, are measured.
ROUNDS = 5
# Of the chapter's 57 candidates, those that SIPPY is timed at; the rest is extrapolated.
SAMPLE = (
    armax_orders(6, 6, 6, 3),
    armax_orders(9, 9, 9, 1),
    armax_orders(10, 10, 10, 3),
    armax_orders(14, 14, 14, 3),
    armax_orders(7, 7, 4, 3),
    armax_orders(7, 7, 14, 3),
    armax_orders(7, 3, 7, 3),
    armax_orders(7, 14, 7, 3),
)


def chapter_candidates() -> list[Orders]:
    """The delay sweep and the three phases of the chapter, section 5."""
    delay = [armax_orders(k, k, k, nk) for k in range(6, 10) for nk in range(4)]
    plant = [armax_orders(k, k, k, 3) for k in range(6, 15)]
    nc = [armax_orders(7, 7, k, 3) for k in range(2, 17)]
    nb = [armax_orders(7, k, 7, 3) for k in range(2, 17)]
    return list(dict.fromkeys([*delay, *plant, *nc, *nb]))


def problem(seed: int, orders: Orders, samples: int = SAMPLES) -> PolynomialErrors:
    record = armax(seed, samples)[0]
    first = max(orders.first_residual, 3)
    start = first + max(20, orders.nc)
    return PolynomialErrors(
        record.segments, orders, "quadratic", 0.9999, 0.9999, False, ScoringWindow(first, start)
    )


def in_turns(*actions: Callable[[], object], rounds: int) -> list[float]:
    """Median processor time of each action, in seconds, the actions taken in turns."""
    times: list[list[float]] = [[] for _ in actions]
    for action in actions:
        action()
    for _ in range(rounds):
        for taken, action in zip(times, actions, strict=True):
            began = time.process_time()
            action()
            taken.append(time.process_time() - began)
    return [float(np.median(taken)) for taken in times]


def one_pass() -> list[str]:
    """Value and gradient of a candidate against scipy.signal.lfilter's value alone."""
    errors = problem(1, ORDERS)
    generator = np.random.default_rng(1)
    points, _ = PolynomialProblem(errors).draw(LANES, generator)
    none = np.zeros(LANES)
    point = points[0]
    a = np.concatenate([[1.0], point[:7]])
    b = np.concatenate([np.zeros(3), point[7:13]])
    c = np.concatenate([[1.0], point[13:20]])

    def by_filters() -> None:
        for _ in range(20):
            e = lfilter(a, c, errors.output) - lfilter(b, c, errors.inputs[:, 0])
            float(e @ e)

    def by_kernels() -> None:
        for _ in range(20):
            errors.values_and_gradients(points, none, none)

    filters, kernels = in_turns(by_filters, by_kernels, rounds=15)
    kernel = 1e6 * kernels / 20 / LANES
    value = 1e6 * filters / 20
    return [
        f"| value and gradient: {kernel:.1f} µs "
        f"| `lfilter`, value alone: {value:.0f} µs | {kernel / value:.2f} |"
    ]


def search(seed: int, orders: Orders) -> tuple[float, float]:
    """Objective and seconds of one whole global search, default settings."""
    errors = problem(seed, orders)
    began = time.process_time()
    result = global_search(PolynomialProblem(errors), SearchSettings(), np.random.default_rng(1))
    seconds = time.process_time() - began
    return of_point(errors, result.point), seconds


def sippy(seed: int, orders: Orders) -> tuple[float, float]:
    """Objective and seconds of SIPPY's ARMAX by optimisation, from its own start."""
    from sippy_unipi import system_identification

    errors = problem(seed, orders)
    began = time.process_time()
    with Path(os.devnull).open("w", encoding="utf-8") as sink:
        kept = os.dup(1)
        os.dup2(sink.fileno(), 1)  # its solver prints
        try:
            model = system_identification(
                errors.output,
                errors.inputs[:, 0],
                "ARMAX",
                ARMAX_orders=[orders.na, orders.single.nb, orders.nc, orders.single.nk - 1],
                ARMAX_mod="OPT",
                max_iterations=200,
            )
        finally:
            sys.stdout.flush()
            os.dup2(kept, 1)
            os.close(kept)
    seconds = time.process_time() - began
    return objective_of(errors, *polynomials(model, orders)), seconds


def polynomials(model: object, orders: Orders) -> tuple[Array, Array, Array]:
    """a, b, c of SIPPY's transfer functions, whatever powers of z they are written in."""

    def response(function: object) -> tuple[Array, Array]:
        numerator = np.ravel(function.num[0][0])  # type: ignore[attr-defined]
        denominator = np.ravel(function.den[0][0])  # type: ignore[attr-defined]
        delay = np.zeros(len(denominator) - len(numerator))
        impulse = np.eye(1, 400)[0]
        padded = np.concatenate([delay, numerator])
        return lfilter(padded, denominator, impulse), denominator / denominator[0]

    g, a = response(model.G)  # type: ignore[attr-defined]
    h, _ = response(model.H)  # type: ignore[attr-defined]
    a = a[: orders.na + 1]
    b = np.convolve(a, g)[orders.single.nk : orders.single.nk + orders.single.nb]
    c = np.convolve(a, h)[: orders.nc + 1]
    return a, b, c


def objective_of(errors: PolynomialErrors, a: Array, b: Array, c: Array) -> float:
    """The objective of a model, with a noise state of moderate size fitted to it.

    One for all methods: where C has forgotten its start before the scored samples, an enormous
    state would fit a few residuals more, and say nothing of the model.
    """
    o = errors.orders
    point = np.concatenate([a[1:], b, c[1:], np.zeros(o.nc)])
    window = errors.window
    impulses = np.eye(len(errors.output) - window.residual_start, o.nc)
    kept = slice(window.loss_start - window.residual_start, None)
    columns = lfilter([1.0], c, impulses, axis=0)[kept]
    e = errors.residuals(point)
    if not (np.isfinite(e).all() and np.isfinite(columns).all()):
        return np.inf  # C is not invertible
    state = np.linalg.lstsq(columns, -e, rcond=1e-3)[0]
    e = e + columns @ state
    y = errors.scored_outputs()
    return float(100.0 * (e @ e) / (y @ y))


def of_point(errors: PolynomialErrors, point: Array) -> float:
    o = errors.orders
    a, b, c, _ = np.split(point, [o.na, o.na + o.single.nb, o.parameters])
    return objective_of(errors, np.concatenate([[1.0], a]), b, np.concatenate([[1.0], c]))


def scipy_local(seed: int, orders: Orders) -> tuple[float, float]:
    """One Levenberg-Marquardt run by MINPACK from stage one, Jacobian by SciPy's filters."""
    errors = problem(seed, orders)
    start = PolynomialProblem(errors).lowest_estimates(1)[0][0]
    filtered = FilteredResiduals(errors)
    began = time.process_time()
    found = least_squares(filtered.residuals, start, filtered.jacobian, method="lm", x_scale="jac")
    seconds = time.process_time() - began
    return of_point(errors, found.x), seconds


def statsmodels_local(seed: int, orders: Orders, samples: int) -> float:
    """Seconds of statsmodels' exact maximum likelihood with lagged inputs as regressors.

    Not the same model (regression with ARMA errors), but what its users take for one.
    """
    from statsmodels.tsa.arima.model import ARIMA

    record = armax(seed, samples)[0]
    lags = range(orders.single.nk, orders.single.nk + orders.single.nb)
    regressors = np.column_stack([np.roll(record.input, lag) for lag in lags])[30:]
    began = time.process_time()
    ARIMA(record.output[30:], regressors, order=(orders.na, 0, orders.nc), trend="n").fit()
    return time.process_time() - began


def local_runs_and_searches() -> tuple[list[tuple[float, float]], list[tuple[float, float]]]:
    """Objective and median seconds of both for each record, the two taken in turns."""
    rounds = [
        [(scipy_local(seed, ORDERS), search(seed, ORDERS)) for seed in RECORDS]
        for _ in range(ROUNDS)
    ]

    def medians(method: int) -> list[tuple[float, float]]:
        return [
            (rounds[0][row][method][0], float(np.median([r[row][method][1] for r in rounds])))
            for row in range(len(RECORDS))
        ]

    return medians(0), medians(1)


def whole_searches() -> list[str]:
    sippy(1, armax_orders(2, 2, 2, 1))  # its imports
    local, searches = local_runs_and_searches()
    ours = float(np.mean([seconds for _, seconds in searches]))
    rows = []
    of_sippy = [sippy(seed, ORDERS) for seed in RECORDS]
    for name, results in (("SIPPY 1.0 ARMAX `OPT`", of_sippy), ("SciPy `least_squares`", local)):
        theirs = float(np.mean([seconds for _, seconds in results]))
        worse = max(own / other - 1 for (own, _), (other, _) in zip(searches, results, strict=True))
        least = min(own / other - 1 for (own, _), (other, _) in zip(searches, results, strict=True))
        rows.append(
            f"| a whole global search, ARMAX(7,6,7,3): {ours:.3f} s; objective {least:+.1e} to "
            f"{worse:+.1e} relative to theirs | {name}, one local run: {theirs:.3f} s "
            f"| {ours / theirs:.3g} |"
        )
    seconds = statsmodels_local(1, ORDERS, SAMPLES)
    rows.append(
        f"| the same search | statsmodels `ARIMA` with lagged inputs: {seconds:.1f} s "
        f"| {ours / seconds:.3g} |"
    )
    candidates = chapter_candidates()
    own = sum(search(1, orders)[1] for orders in candidates)
    sampled = [sippy(1, orders)[1] for orders in SAMPLE]
    theirs = float(np.mean(sampled)) * len(candidates)
    rows.append(
        f"| the chapter's {len(candidates)} candidates: {own:.0f} s "
        f"| SIPPY `OPT`, extrapolated from {len(SAMPLE)} of them: {theirs:.0f} s "
        f"| {own / theirs:.3g} |"
    )
    return rows


def order_search(prune: bool) -> tuple[str, int, float]:
    """Orders, evaluations and seconds of all phases with the built-in grids."""
    data = armax(1, SAMPLES)[0]
    search = SearchSettings(objective="quadratic", prune=prune)
    keys = {"synthesis": "armax", "recipe": "chapter"}
    settings = complete({"datasets": {"record": keys}}).datasets["record"]
    window, grid = scoring_window(settings), settings.order_grid
    first = first_pass(search) if prune else search
    known: dict[Orders, Candidate] = {}
    selected, evaluations, began = None, 0, time.process_time()
    for phase in phases_of_dataset(settings):
        orders = [orders_of("armax", each) for each in candidate_orders(phase, grid, selected)]
        new = [each for each in orders if each not in known]
        known |= {
            each.orders: each
            for each in estimate_candidates(OrderSearch(data, first, window), new, phase)
        }
        own = [replace(known[each], phase=phase, pruned="") for each in orders]
        min_delay = grid.ranges.nk[0] if phase == DELAY_REFINED_IN else None
        selection = select_candidate(OrderSearch(data, search, window), own, phase, min_delay)
        evaluations += sum(each.diagnostics.evaluations for each in selection.candidates)
        known = {each.orders: each for each in selection.candidates}
        selected = selection.orders.single._asdict()
    return str(selection.orders), evaluations, time.process_time() - began


def order_searches() -> list[str]:
    """The race of the candidates against the full search of every one."""
    orders, evaluations, seconds = order_search(prune=True)
    other, in_full, longer = order_search(prune=False)
    return [
        f"| order search, built-in grids, {evaluations} evaluations: "
        f"{seconds:.1f} s; chosen {orders} | every candidate in full (`prune: false`), {in_full} "
        f"evaluations: {longer:.1f} s; chosen {other} | {seconds / longer:.3g} |"
    ]


def keep_history(rows: list[str]) -> None:
    """Append the ratios of this run to the history, by commit."""
    commit = subprocess.run(
        ["git", "rev-parse", "--short", "HEAD"], cwd=ROOT, capture_output=True, text=True
    ).stdout.strip()
    new = not HISTORY.exists()
    with HISTORY.open("a", encoding="utf-8", newline="") as sink:
        table = csv.writer(sink, lineterminator="\n")
        if new:
            table.writerow(["commit", "evopem", "compared with", "ratio"])
        for row in rows:
            table.writerow([commit, *(cell.strip() for cell in row.strip("| ").split(" | "))])


SCALING = """
import sys, time, tracemalloc
sys.path.insert(0, {scripts!r})
import numpy as np
from evopem import SearchSettings, estimate
from evopem.synthesis import armax  # noqa: E402
record = armax(1, {samples})[0]
settings = SearchSettings(objective="quadratic")
u, y = record.input, record.output
estimate(u[:1000], y[:1000], {orders}, 100.0, settings=settings)
began = time.process_time()
found = estimate(u, y, {orders}, 100.0, settings=settings)
taken = time.process_time() - began
tracemalloc.start()
estimate(u, y, {orders}, 100.0, settings=settings)
evaluations = found.search.diagnostics.evaluations
print(taken / evaluations * 1e6, tracemalloc.get_traced_memory()[1] / {samples})
"""


def scaling() -> list[list[str]]:
    """Processor time of an evaluation and memory of an estimate, over N and over n."""
    rows = []
    cases = [(samples, (8, 8, 8, 1)) for samples in (10**3, 10**4, 10**5, 10**6)]
    cases += [(SAMPLES, (k, k, k, 1)) for k in (2, 5, 10, 20)]
    for samples, orders in cases:
        code = SCALING.format(scripts=str(SCRIPTS), samples=samples, orders=orders)
        printed = subprocess.run(
            [sys.executable, "-c", code], capture_output=True, text=True, check=True
        ).stdout
        microseconds, each = map(float, printed.split())
        rows.append(
            [
                str(samples),
                str(sum(orders[:3])),
                f"{1000 * microseconds / samples:.2f}",
                f"{each:.0f}",
            ]
        )
    return rows


FIRST_FIT = """
import sys; sys.path.insert(0, {scripts!r})
import numpy as np
from evopem import SearchSettings, estimate
u, y = np.random.default_rng(1).standard_normal((2, 300))
settings = SearchSettings(mu=4, lambda_=4, nu=4, evaluations=1)
estimate(u, y, (2, 2, 2, 1), 1.0, settings=settings)
print(__import__("time").process_time())
"""
# Nothing that numba has compiled can be called for less.
FLOOR = """
import numba
import numpy as np
@numba.njit(cache=True)
def total(x):
    return x.sum()
total(np.zeros(3))
print(__import__("time").process_time())
"""


def start_up() -> list[str]:
    """From the start of a process to the end of its first fit, and what numba alone takes."""

    def seconds(script: Path) -> float:
        kept = {"NUMBA_CACHE_DIR": str(script.parent), "PYTHONPYCACHEPREFIX": str(script.parent)}
        # As of an installation, whose modules have their bytecode beside them.
        environment = os.environ | kept | {"PYTHONDONTWRITEBYTECODE": ""}
        command = [sys.executable, str(script)]
        run = subprocess.run(
            command, env=environment, check=True, stdout=subprocess.PIPE, text=True
        )
        return float(run.stdout)

    with tempfile.TemporaryDirectory() as folder:
        fit, floor = Path(folder) / "fit.py", Path(folder) / "floor.py"
        fit.write_text(FIRST_FIT.format(scripts=str(SCRIPTS)))
        floor.write_text(FLOOR)
        compiling = seconds(fit)
        seconds(floor)
        measured = [(seconds(fit), seconds(floor)) for _ in range(5)]
    later, least = (float(np.median(taken)) for taken in zip(*measured, strict=True))
    return [
        f"| process start to first fit: {later:.2f} s | imports and one "
        f"function of numba: {least:.2f} s | {later / least:.3g} |",
        f"| the same, compiling the kernels: {compiling:.1f} s "
        f"| every later process: {later:.2f} s | {compiling / later:.3g} |",
    ]


def main() -> None:
    with threadpool_limits(limits=1):
        estimate(*np.random.default_rng(1).standard_normal((2, 300)), (2, 2, 2, 1), 1.0)  # compile
        compared = [*one_pass(), *whole_searches(), *order_searches(), *start_up()]
        print("\n".join(compared), flush=True)
    keep_history(compared)
    write_section(
        "speed",
        "Against alternatives",
        f"ARMAX(7,6,7,3), {SAMPLES} samples, quadratic objective; searches are means over "
        f"{len(RECORDS)} records of medians of {ROUNDS} runs. Ratios are the result: seconds "
        "(processor time)\nvary with the machine.",
        "make bench",
        ("evopem", "compared with", "ratio"),
        [row.strip("| ").split(" | ") for row in compared],
    )
    write_several_channels()
    columns = scaling()
    write_section(
        "speed",
        "Length and order",
        "Whole estimates by samples and parameters: ns a sample and evaluation, and bytes a sample "
        "that their arrays take at most beside the record.",
        "make bench",
        ("samples", *(column[0] for column in columns)),
        [
            [name, *(column[place] for column in columns)]
            for place, name in enumerate(("parameters", "ns", "bytes"), 1)
        ],
    )


if __name__ == "__main__":
    main()
