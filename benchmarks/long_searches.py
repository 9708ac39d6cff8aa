"""The search of long records on blocks of them, against the same search on all samples.

    python benchmarks/long_searches.py [problems]

Writes "Long recordings" of docs/evidence/speed.md.  Random systems of five structures, a third of
them of fewer orders than they have, some with a narrow-band input or heavy-tailed noise, of a
million samples, and two of known orders of ten million: the objectives that both searches reach,
and their processor time, with the covariance and the residuals of the model.
"""

import sys
import time

import numpy as np
from evidence import write_section
from scipy.signal import lfilter

from evopem.config.settings import SearchSettings
from evopem.estimation.estimate import estimate_polynomial
from evopem.estimation.search import blocks
from evopem.models.orders import Orders
from evopem.signals.recording import Recording

STRUCTURES = ("armax", "oe", "bj", "arx", "ararmax")
SETTINGS = SearchSettings(objective="quadratic", evaluations=8000)
# Structures and plant orders of the longest records; of ARMAX C is as long.
LONGEST = (("armax", 2), ("oe", 4))


def polynomial(generator: np.random.Generator, order: int, radius: float = 0.98) -> np.ndarray:
    """A monic polynomial with random roots, pairs of them and perhaps a real one."""
    coefficients = np.ones(1)
    for _ in range(order // 2):
        r, turn = generator.uniform(0.6, radius), generator.uniform(0.1, 2.9)
        coefficients = np.convolve(coefficients, [1.0, -2.0 * r * np.cos(turn), r * r])
    if order % 2:
        coefficients = np.convolve(coefficients, [1.0, -generator.uniform(-0.9, 0.95)])
    return coefficients


def problem(
    seed: int, samples: int, known: tuple[str, int] | None = None
) -> tuple[Recording, Orders]:
    """A random record, and the orders that it is searched with: ``known`` ones or random ones."""
    generator = np.random.default_rng(seed)
    structure = STRUCTURES[seed % len(STRUCTURES)]
    n, nc = int(generator.integers(2, 7)), int(generator.integers(1, 4))
    if known:
        structure, n, nc = *known, known[1]
    u, e = generator.standard_normal((2, samples))
    if generator.random() < 0.5:
        u = lfilter([1.0], [1.0, -0.9], u)
    if generator.random() < 0.3:
        e = generator.standard_t(4, samples)
    a, b = polynomial(generator, n), np.append(0.0, generator.standard_normal(n))
    c, d, one = polynomial(generator, nc, 0.9), polynomial(generator, nc, 0.9), np.ones(1)
    noises = {
        "armax": (c, a),
        "oe": (one, one),
        "bj": (c, d),
        "arx": (one, a),
        "ararmax": (c, np.convolve(a, d)),
    }
    x, v = lfilter(b, a, u), lfilter(*noises[structure], e)
    y = x + v * np.std(x) / np.std(v) * 10 ** generator.uniform(-1.5, 0.3)
    m = n - int(generator.integers(0, 2)) if generator.random() < 0.3 and not known else n
    orders = {
        "armax": Orders(na=m, nb=m, nc=nc, nk=1),
        "oe": Orders(nf=m, nb=m, nk=1),
        "bj": Orders(nf=m, nb=m, nc=nc, nd=nc, nk=1),
        "arx": Orders(na=m, nb=m, nk=1),
        "ararmax": Orders(na=m, nb=m, nc=nc, nd=nc, nk=1),
    }
    return Recording(u, y, 1.0), orders[structure]


def searched(record: Recording, orders: Orders, level: bool) -> list[str]:
    """Objectives and seconds of both searches: in blocks first, and on all samples."""
    values, seconds, long = [], [], blocks.LONG
    for times in (long, len(record.output)):
        blocks.LONG, began = times, time.process_time()
        estimate = estimate_polynomial(record, orders, settings=SETTINGS, level=level)
        seconds.append(time.process_time() - began)
        values.append(estimate.search.value)
    blocks.LONG = long
    cells = [*(f"{value:.9g}" for value in values), *(f"{s:.1f}" for s in seconds)]
    row = [f"{len(record.output):.0e}".replace("1e+0", "10^"), str(orders), *cells]
    print("|", " | ".join(row), "|", flush=True)
    return row


def main(problems: int = 22) -> None:
    estimate_polynomial(*problem(0, 2000), settings=SETTINGS)  # compiles
    rows = [searched(*problem(k, 1_000_000), k % 2 == 0) for k in range(problems)]
    rows += [searched(*problem(k, 10_000_000, known), False) for k, known in enumerate(LONGEST)]
    write(rows)


def write(rows: list[list[str]]) -> None:
    """The section, of what :func:`searched` gives of each problem."""
    same = sum(row[2] == row[3] for row in rows)
    sums = [sum(float(row[k]) for row in rows) for k in (4, 5)]
    write_section(
        "speed",
        "Long recordings",
        f"{len(rows)} random problems: polynomial models searched on blocks of the record against "
        "the search of all samples,\neach at most 8000 evaluations, processor time with residuals "
        f"and covariance. The objectives agree to nine digits in {same} problems; the times\nadd "
        f"up to {sums[0]:.0f} s and {sums[1]:.0f} s.",
        "benchmarks/long_searches.py",
        [
            *("samples", "orders", "objective in blocks, then on all", "on all samples"),
            *("s", "s on all samples"),
        ],
        rows,
    )


if __name__ == "__main__":
    main(*map(int, sys.argv[1:]))
