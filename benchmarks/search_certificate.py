"""How often is a certified search wrong?  Writes docs/evidence/certificate.md.

    python benchmarks/search_certificate.py [--problems 500] [--first 0] [--file FOLDER/runs.jsonl]

Each problem is a random model of one of several structures, a record of it, and orders that are
those of the model or twice as large.  The default search is compared with the best that other seeds
and ten times the evaluations find, without an early end.  The problems already in the file are not
computed again.
"""

from __future__ import annotations

import argparse
import json
import sys
import time
from dataclasses import replace
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from threadpoolctl import threadpool_limits

ROOT = Path(__file__).resolve().parent.parent
sys.path.insert(0, str(ROOT / "workflow" / "scripts"))

from evopem import PolynomialModel, SearchSettings  # noqa: E402
from evopem.estimation import polynomial_estimate  # noqa: E402
from evopem.estimation.estimate import _scaled_problem, default_window, prediction_errors  # noqa: E402
from evopem.estimation.search.global_search import global_search  # noqa: E402
from evopem.models.structures import PolynomialOrders, orders_of  # noqa: E402
from evopem.synthesis.polynomial import polynomial_record  # noqa: E402
from evopem.config.settings import ScoringWindow  # noqa: E402

Array = NDArray[np.float64]

# Half of the problems are ARMAX models, which have a search of their own.
STRUCTURES = ("armax",) * 5 + ("oe", "bj", "arma", "ararx", "ararmax")
LENGTHS = (200, 500, 1000, 2000, 4000)
NOISES = (5.0, 50.0)
OBJECTIVES = ("quadratic", "absolute")
# Relative distance above the best known value from which on a search is wrong.
WRONG = 1e-6
REFERENCE_FACTOR = 10
# Distances of poles and zeros from the unit circle.
FARTHEST, NEAREST = 0.4, 0.01


class Case(NamedTuple):
    """What a problem is made of."""

    index: int
    structure: str
    samples: int
    noise: float
    objective: str
    larger: bool


def case_of(index: int) -> Case:
    """Every combination in turn: 200 of them are a full factorial."""
    generator = np.random.default_rng([2026, index])
    return Case(
        index,
        STRUCTURES[index % len(STRUCTURES)],
        int(generator.choice(LENGTHS)),
        NOISES[index // 10 % 2],
        OBJECTIVES[index // 20 % 2],
        bool(index // 40 % 2),
    )


def polynomial(degree: int, generator: np.random.Generator) -> Array:
    """A monic polynomial with roots spread over all frequencies and over the damping."""
    pairs = degree // 2
    radii = 1.0 - FARTHEST * (NEAREST / FARTHEST) ** generator.random(pairs)
    upper = radii * np.exp(1j * np.pi * generator.random(pairs))
    real = generator.uniform(-0.9, 0.9, degree % 2)
    return np.atleast_1d(np.real(np.poly(np.concatenate([upper, upper.conj(), real]))))


def truth_of(case: Case, generator: np.random.Generator) -> PolynomialModel:
    largest = 3 if case.samples <= 200 else 4 if case.samples <= 500 else 6
    k = int(generator.integers(2, largest + 1))
    noise = int(generator.integers(1, min(k, 3) + 1))
    one = np.ones(1)
    b = generator.standard_normal(k)
    c, d = polynomial(noise, generator), polynomial(min(noise, 2), generator)
    plant = polynomial(k, generator)
    nk = int(generator.integers(0, 3))
    return {
        "armax": lambda: PolynomialModel(plant, b, polynomial(k, generator), one, one, nk),
        "oe": lambda: PolynomialModel(one, b, one, one, plant, nk),
        "bj": lambda: PolynomialModel(one, b, c, d, plant, nk),
        "arma": lambda: PolynomialModel(plant, np.empty(0), c, one, one, 0),
        "ararx": lambda: PolynomialModel(plant, b, one, d, one, nk),
        "ararmax": lambda: PolynomialModel(plant, b, c, d, one, nk),
    }[case.structure]()


def orders_of_case(case: Case, truth: PolynomialModel) -> PolynomialOrders:
    o = truth.orders
    factor = 2 if case.larger else 1
    names = {name: factor * getattr(o, name) for name in ("na", "nb", "nc", "nd", "nf")}
    given = {name: order for name, order in names.items() if order}
    return orders_of(case.structure, given | ({"nk": o.nk} if o.nk else {}))


def problem_of(case: Case):
    generator = np.random.default_rng([2027, case.index])
    truth = truth_of(case, generator)
    u, y, _ = polynomial_record(truth, case.samples, case.noise, generator)
    orders = orders_of_case(case, truth)
    settings = SearchSettings(objective=case.objective)
    if case.structure == "armax":
        window = default_window(orders, settings)
        errors = prediction_errors(u, y, orders, settings, window)
        problem = lambda: _scaled_problem(errors, "arx")[0]  # noqa: E731
        return problem, settings, None, orders
    if not orders.nb:
        u = np.zeros_like(y)
    window = ScoringWindow(orders.first_residual, orders.first_residual)
    errors = polynomial_estimate.polynomial_errors(u, y, orders, settings, window, False)
    problem = lambda: polynomial_estimate.scaled_problem(errors)[0]  # noqa: E731
    return problem, settings, True, orders


def run(case: Case) -> dict[str, object]:
    problem, settings, by_roots, orders = problem_of(case)

    def search(settings, seed, **more):
        p = problem()
        recombine = p.recombine if by_roots else None
        return global_search(
            p, settings, np.random.default_rng([case.index, seed]), recombine=recombine, **more
        )

    began = time.process_time()
    found = search(settings, 1)
    seconds = time.process_time() - began
    began = time.process_time()
    more = replace(settings, evaluations=REFERENCE_FACTOR * settings.evaluations)
    references = [search(more, 2, agreeing_restarts=10**6)]
    references += [search(settings, s) for s in (3, 4)]
    reference = min(each.value for each in references)
    d = found.diagnostics
    return {
        **case._asdict(),
        "orders": str(orders),
        "n": orders.parameters,
        "value": found.value,
        "best": min(found.value, reference),
        "excess": found.value / min(found.value, reference) - 1.0,
        "evaluations": d.evaluations,
        "seconds": seconds,
        "reference_seconds": time.process_time() - began,
        "minima": d.restart_minima,
        "confirming": d.n_confirming,
        "distinct": d.n_local_optima,
        "multistart": d.n_multistart,
        "undiscovered": d.undiscovered_probability,
        "reference_minima": references[0].diagnostics.restart_minima,
        "reference_values": [r.value for r in references],
        "reference_certified": [
            (r.diagnostics.n_confirming, r.diagnostics.undiscovered_probability) for r in references
        ],
    }


def main() -> None:
    parser = argparse.ArgumentParser()
    parser.add_argument("--problems", type=int, default=500)
    parser.add_argument("--first", type=int, default=0)
    parser.add_argument("--file", type=Path, required=True)
    arguments = parser.parse_args()
    done = set()
    if arguments.file.exists():
        done = {json.loads(line)["index"] for line in arguments.file.open()}
    with threadpool_limits(limits=1):
        for index in range(arguments.first, arguments.problems):
            if index not in done:
                row = run(case_of(index))
                with arguments.file.open("a") as sink:
                    sink.write(json.dumps(row) + "\n")


if __name__ == "__main__":
    main()
