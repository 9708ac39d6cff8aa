"""Compare the polynomial structures with other packages; its section of docs/evidence.

    python benchmarks/polynomial_peers.py [--records 5]

SIPPY (`pip install sippy-unipi`), pysib (`pip install pysib`) and statsmodels, each where it has
the structure.  The models are compared by one objective, whose initial states are fitted to each
model's coefficients by linear least squares: what a package assumes of the past does not count.
"""

from __future__ import annotations

import argparse
import contextlib
import os
import sys
import time
import warnings
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy.signal import lfilter
from threadpoolctl import threadpool_limits

ROOT = Path(__file__).resolve().parent.parent
sys.path[:0] = [str(ROOT / "workflow" / "scripts"), str(ROOT / "tests")]

from evidence import write_section  # noqa: E402
from filtered_polynomials import FilteredPolynomials  # noqa: E402
from polynomial_structures import QUADRATIC, TRUTHS, named  # noqa: E402
from simulated_records import polynomial_record  # noqa: E402

from evopem import Orders, PolynomialModel, estimate  # noqa: E402

Array = NDArray[np.float64]
# The coefficients a, b, c, d, f without leading ones.
Coefficients = tuple[Array, Array, Array, Array, Array]

NONE = np.empty(0)
ONE = np.ones(1)
SAMPLES, NOISE = 1000, 20.0


def truths() -> dict[str, PolynomialModel]:
    colour, damped = TRUTHS["bj"].C, TRUTHS["bj"].D
    b = np.array([1.0, 0.6, 0.3])
    return {
        **{name: TRUTHS[name] for name in ("arx", "arma", "ararx", "ararmax", "oe", "bj")},
        "bj without F": PolynomialModel(ONE, b, colour, damped, ONE, 1),
    }


@contextlib.contextmanager
def silence() -> Iterator[None]:
    """Without the output of solvers that write to the process's own."""
    sys.stdout.flush()
    kept = os.dup(1)
    with Path(os.devnull).open("w", encoding="utf-8") as sink:
        os.dup2(sink.fileno(), 1)
        try:
            with warnings.catch_warnings():
                warnings.simplefilter("ignore")
                yield
        finally:
            sys.stdout.flush()
            os.dup2(kept, 1)
            os.close(kept)


def sippy(structure: str, o: Orders, u: Array, y: Array) -> Coefficients:
    """SIPPY's estimate, its polynomials from the impulse responses of its transfer functions."""
    from sippy_unipi import system_identification

    name = structure.upper()
    order = {
        "OE": [o.single.nb, o.single.nf, o.single.nk - 1],
        "BJ": [o.single.nb, o.nc, o.nd, o.single.nf, o.single.nk - 1],
        "ARARX": [o.na, o.single.nb, o.nd, o.single.nk - 1],
        "ARARMAX": [o.na, o.single.nb, o.nc, o.nd, o.single.nk - 1],
    }[name]
    model = system_identification(y, u, name, **{f"{name}_orders": order}, max_iterations=200)
    g, below_g = response(model.G)
    h, below_h = response(model.H)
    plant = below_g[: max(o.na, o.single.nf) + 1]
    b = np.convolve(plant, g)[o.single.nk : o.single.nk + o.single.nb]
    a, f = (plant, ONE) if o.na else (ONE, plant)
    d = lfilter(below_h, a, np.eye(1, 400)[0])[: o.nd + 1]
    c = np.convolve(np.convolve(a, d), h)[: o.nc + 1]
    return a[1:], b, c[1:], d[1:], f[1:]


def response(function: object) -> tuple[Array, Array]:
    """Impulse response and denominator, whatever powers of z the function is written in."""
    numerator = np.ravel(function.num[0][0])  # type: ignore[attr-defined]
    denominator = np.ravel(function.den[0][0])  # type: ignore[attr-defined]
    delay = np.zeros(len(denominator) - len(numerator))
    impulse = lfilter(np.concatenate([delay, numerator]), denominator, np.eye(1, 400)[0])
    return impulse, denominator / denominator[0]


def pysib(structure: str, o: Orders, u: Array, y: Array) -> Coefficients:
    import pysib as package

    if structure == "arx":
        theta, _ = package.arx(u, y, o.na, o.single.nb, o.single.nk)
        theta = np.ravel(theta)
        return theta[: o.na], theta[o.na :], NONE, NONE, NONE
    if structure == "oe":
        theta = np.ravel(package.oe(u, y, o.single.nb, o.single.nf, o.single.nk)[0])
        return NONE, theta[: o.single.nb], NONE, NONE, theta[o.single.nb :]
    theta = np.ravel(package.bj(u, y, o.single.nb, o.nc, o.nd, o.single.nf, o.single.nk)[0])
    b, c, d, f = np.split(theta, np.cumsum([o.single.nb, o.nc, o.nd]))
    return NONE, b, c, d, f


def statsmodels(structure: str, o: Orders, u: Array, y: Array) -> Coefficients:
    """Exact Gaussian likelihood by a Kalman filter; least squares for ARX."""
    from statsmodels.tsa.ar_model import AutoReg
    from statsmodels.tsa.statespace.sarimax import SARIMAX

    first = o.first_residual
    lagged = [
        u[first - lag : len(u) - lag] for lag in range(o.single.nk, o.single.nk + o.single.nb)
    ]
    if structure == "arma":
        found = SARIMAX(y, order=(o.na, 0, o.nc)).fit(disp=False, maxiter=200).params
        return -found[: o.na], NONE, found[o.na : o.na + o.nc], NONE, NONE
    regressors = np.column_stack(lagged)
    if structure == "arx":
        padded = np.concatenate([np.zeros((first, o.single.nb)), regressors])
        found = AutoReg(y, o.na, trend="n", exog=padded, hold_back=first).fit().params
        return -found[: o.na], found[o.na :], NONE, NONE, NONE
    fitted = SARIMAX(y[first:], regressors, order=(o.nd, 0, o.nc)).fit(disp=False, maxiter=200)
    b, d, c, _ = np.split(fitted.params, np.cumsum([o.single.nb, o.nd, o.nc]))
    return NONE, b, c, -d, NONE


def evopem(structure: str, o: Orders, u: Array, y: Array) -> Coefficients:
    own = structure.split()[0]
    found = estimate(
        None if own == "arma" else u, y, named(o), structure=own, settings=QUADRATIC
    ).model
    return found.A[1:], found.B[0], found.C[1:], found.D[1:], found.F[0][1:]


def objective(filtered: FilteredPolynomials, coefficients: Coefficients) -> float:
    """The objective with the states that fit best; the residuals are linear in them."""
    a, b, c, d, f = coefficients
    known = len(np.concatenate(coefficients))
    point = np.zeros(filtered.dimension)
    point[:known] = np.concatenate([a, b, c, d, f])
    if not filtered.stable(point, 1.0):
        return np.inf
    base, columns = filtered.residuals(point), filtered.jacobian(point)[:, known:]
    point[known:] = np.linalg.lstsq(columns, -base, rcond=None)[0]
    return filtered.objective(point)


PEERS: tuple[tuple[str, Callable[..., Coefficients], tuple[str, ...]], ...] = (
    ("SIPPY", sippy, ("oe", "bj", "ararx", "ararmax")),
    ("pysib", pysib, ("arx", "oe", "bj")),
    ("statsmodels", statsmodels, ("arx", "arma", "bj without F")),
)


def timed(
    method: Callable[..., Coefficients], *arguments: object
) -> tuple[Coefficients | None, float]:
    began = time.process_time()
    try:
        with silence():
            found = method(*arguments)
    except Exception as error:
        print(f"{method.__name__} {arguments[0]}: {error!r}", flush=True)
        return None, time.process_time() - began
    return found, time.process_time() - began


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--records", type=int, default=5)
    chosen = parser.parse_args()
    rows = []
    with threadpool_limits(1, "blas"):
        for name, method, structures in PEERS:
            for structure in structures:
                rows.append(compared(name, method, structure, chosen.records))
                print(rows[-1], flush=True)
    write_section(
        "structures",
        "Other packages",
        f"{chosen.records} records of {SAMPLES} samples a structure at the true orders, noise "
        f"{NOISE:g} %: the whole global search against one local run of the other package.\n"
        "Objective relative to theirs, less 1: negative where evopem's is lower.",
        "benchmarks/polynomial_peers.py",
        ("structure", "other", "s", "theirs, s", "objective, range"),
        rows,
    )


def compared(
    name: str, method: Callable[..., Coefficients], structure: str, records: int
) -> list[str]:
    truth = truths()[structure]
    o = truth.orders
    sizes = (o.na, o.single.nb, o.nc, o.nd, o.single.nf, o.single.nk)
    gaps, own_seconds, their_seconds, failed = [], [], [], 0
    for record in range(-1, records):
        sequence = np.random.SeedSequence(max(record, 0), spawn_key=(len(structure),))
        u, y, _ = polynomial_record(truth, SAMPLES, NOISE, np.random.default_rng(sequence))
        filtered = FilteredPolynomials(u, y, sizes, o.first_residual)
        theirs, their_time = timed(method, structure, o, u, y)
        own, own_time = timed(evopem, structure, o, u, y)
        if record < 0:
            continue  # imports, compiled code
        own_seconds.append(own_time)
        their_seconds.append(their_time)
        value = np.inf if theirs is None else objective(filtered, theirs)
        if own is None or not np.isfinite(value):
            failed += 1
            continue
        gaps.append(objective(filtered, own) / value - 1.0)
    ours, their = np.mean(own_seconds), np.mean(their_seconds)
    span = f"{min(gaps):+.1e}…{max(gaps):+.1e}" if gaps else "–"
    if failed:
        span += f" ({failed} of {records} failed)"
    return [structure, name, f"{ours:.2f}", f"{their:.2f}", span]


if __name__ == "__main__":
    main()
