"""The search of long records on blocks of them, against the same search on all samples.

    python benchmarks/long_searches.py [samples] [problems]

Random systems of five structures, a third of them of fewer orders than they have, some with a
narrow-band input or heavy-tailed noise: the objectives that both searches reach, and their
processor time, with the covariance and the residuals of the model.
"""

import sys
import time

import numpy as np
from scipy.signal import lfilter

from evopem.config.settings import SearchSettings
from evopem.estimation.estimate import estimate_polynomial
from evopem.estimation.search import blocks
from evopem.models.orders import Orders
from evopem.signals.recording import Recording

STRUCTURES = ("armax", "oe", "bj", "arx", "ararmax")
SETTINGS = SearchSettings(objective="quadratic", evaluations=8000)


def polynomial(generator: np.random.Generator, order: int, radius: float = 0.98) -> np.ndarray:
    """A monic polynomial with random roots, pairs of them and perhaps a real one."""
    coefficients = np.ones(1)
    for _ in range(order // 2):
        r, turn = generator.uniform(0.6, radius), generator.uniform(0.1, 2.9)
        coefficients = np.convolve(coefficients, [1.0, -2.0 * r * np.cos(turn), r * r])
    if order % 2:
        coefficients = np.convolve(coefficients, [1.0, -generator.uniform(-0.9, 0.95)])
    return coefficients


def problem(seed: int, samples: int) -> tuple[Recording, Orders]:
    """A random record, and the orders that it is searched with."""
    generator = np.random.default_rng(seed)
    structure = STRUCTURES[seed % len(STRUCTURES)]
    n, nc = int(generator.integers(2, 7)), int(generator.integers(1, 4))
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
    m = n - int(generator.integers(0, 2)) if generator.random() < 0.3 else n
    orders = {
        "armax": Orders(na=m, nb=m, nc=nc, nk=1),
        "oe": Orders(nf=m, nb=m, nk=1),
        "bj": Orders(nf=m, nb=m, nc=nc, nd=nc, nk=1),
        "arx": Orders(na=m, nb=m, nk=1),
        "ararmax": Orders(na=m, nb=m, nc=nc, nd=nc, nk=1),
    }
    return Recording(u, y, 1.0), orders[structure]


def main(samples: int = 1_000_000, problems: int = 22) -> None:
    print("| orders | objective in blocks, then on all | on all samples | s | s on all samples |")
    print("| --- | --- | --- | --- | --- |")
    long = blocks.LONG
    for seed in range(problems):
        record, orders = problem(seed, samples)
        values, seconds = [], []
        for times in (long, samples):
            blocks.LONG, began = times, time.process_time()
            estimate = estimate_polynomial(record, orders, settings=SETTINGS, level=seed % 2 == 0)
            seconds.append(time.process_time() - began)
            values.append(estimate.search.value)
        row = orders, *(f"{value:.9g}" for value in values), *(f"{s:.1f}" for s in seconds)
        print("|", " | ".join(map(str, row)), "|", flush=True)


if __name__ == "__main__":
    main(*(int(float(value)) for value in sys.argv[1:]))
