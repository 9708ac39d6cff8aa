"""How often is a certified search wrong?  Writes its section of docs/evidence/search.md.

    python benchmarks/search_certificate.py FILE [--first 2240] [--problems 560]

Each problem is a random model of one of several structures, a record of it, and orders that are
those of the model or twice as large.  Searches by the default settings, with several seeds, are
compared with the lowest of them.  FILE keeps the runs, one a line, and those are not repeated.
"""

from __future__ import annotations

import argparse
import json
import sys
import time
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from evidence import write_section
from numpy.typing import NDArray
from threadpoolctl import threadpool_limits

ROOT = Path(__file__).resolve().parent.parent
sys.path[:0] = [str(ROOT / "workflow" / "scripts"), str(ROOT / "tests")]

from simulated_records import polynomial_record  # noqa: E402

from evopem import PolynomialModel, SearchSettings  # noqa: E402
from evopem.estimation.prediction_errors import (  # noqa: E402
    default_window,
    prediction_errors,
    scaled_errors,
)
from evopem.estimation.search.certificate import (  # noqa: E402
    AFTER_BATCHES,
    AFTER_FEW_OPTIMA,
    AFTER_FIRST_PASS,
    AFTER_RESTART,
    gain_after_first_pass,
    is_certified,
)
from evopem.estimation.search.global_search import (  # noqa: E402
    BATCH,
    FIRST_PASS,
    global_search,
)
from evopem.estimation.search.polynomial_problem import PolynomialProblem  # noqa: E402
from evopem.models.orders import Orders, orders_of  # noqa: E402
from evopem.signals.recording import Recording  # noqa: E402

Row = dict[str, Any]
Array = NDArray[np.float64]

STRUCTURES = ("armax", "oe", "bj", "ararmax", "armax", "ararx", "arma")
# Those of a goal of their own: certificates of searches that found the lowest optimum.
OTHERS = ("oe", "bj", "ararmax")
LENGTHS = (400, 600, 1000)
NOISES = (5.0, 50.0)
OBJECTIVES = ("quadratic", "absolute")
# Relative distance above the best known value up to which a search found it, and from which on a
# certified one is wrong.
FOUND, WRONG = 1e-6, 1e-4
EVALUATIONS = SearchSettings().evaluations
SEEDS = (1, 2)
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
    """Every combination in turn: 56 of them are a full factorial."""
    generator = np.random.default_rng([2028, index])
    return Case(
        index,
        STRUCTURES[index % 7],
        int(generator.choice(LENGTHS)),
        NOISES[index // 28 % 2],
        OBJECTIVES[index // 7 % 2],
        bool(index // 14 % 2),
    )


def polynomial(degree: int, generator: np.random.Generator) -> Array:
    """A monic polynomial with roots spread over all frequencies and over the damping."""
    pairs = degree // 2
    radii = 1.0 - FARTHEST * (NEAREST / FARTHEST) ** generator.random(pairs)
    upper = radii * np.exp(1j * np.pi * generator.random(pairs))
    real = generator.uniform(-0.9, 0.9, degree % 2)
    return np.atleast_1d(np.real(np.poly(np.concatenate([upper, upper.conj(), real]))))


def truth_of(case: Case, generator: np.random.Generator) -> PolynomialModel:
    largest = 4 if case.samples <= 500 else 6
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


def orders_of_case(case: Case, truth: PolynomialModel) -> Orders:
    o = truth.orders
    factor = 2 if case.larger else 1
    names = {name: factor * getattr(o.single, name) for name in ("na", "nb", "nc", "nd", "nf")}
    given = {name: order for name, order in names.items() if order}
    return orders_of(case.structure, given | ({"nk": o.single.nk} if o.single.nk else {}))


def problem_of(case: Case) -> tuple[PolynomialProblem, Orders]:
    generator = np.random.default_rng([2029, case.index])
    truth = truth_of(case, generator)
    u, y, _ = polynomial_record(truth, case.samples, case.noise, generator)
    orders = orders_of_case(case, truth)
    settings = SearchSettings(objective=case.objective)
    window = default_window(orders, settings)
    errors = prediction_errors(Recording(u, y, 1.0), orders, settings, window, False)
    return PolynomialProblem(scaled_errors(errors)[0]), orders


def search(case: Case, seed: int, evaluations: int = EVALUATIONS) -> Row:
    problem, _ = problem_of(case)
    settings = SearchSettings(objective=case.objective, evaluations=evaluations)
    generator = np.random.default_rng([case.index, seed])
    steps: list[str] = []
    began = time.process_time()
    found = global_search(problem, settings, generator, steps.append)
    diagnostics = found.diagnostics
    return {
        "value": found.value,
        "certified": is_certified(diagnostics),
        "evaluations": diagnostics.evaluations,
        "minima": diagnostics.restart_minima,
        "batches": diagnostics.n_multistart // BATCH,
        "confirming": diagnostics.n_confirming,
        "undiscovered": diagnostics.undiscovered_probability,
        "seconds": time.process_time() - began,
        "steps": steps,
    }


def run(case: Case) -> Row:
    _, orders = problem_of(case)
    first, searches = search(case, 3, FIRST_PASS), [search(case, seed) for seed in SEEDS]
    return {
        **case._asdict(),
        "orders": str(orders),
        "parameters": orders.parameters,
        "first": first,
        "searches": searches,
        "best": min(each["value"] for each in searches),
    }


def rates(rows: list[Row]) -> str:
    """Searches that found the lowest value, certified ones of them, all certified, wrong ones."""
    searches = [
        (each, each["value"] / row["best"] - 1.0) for row in rows for each in row["searches"]
    ]
    found = [each["certified"] for each, excess in searches if excess <= FOUND]
    certified = [excess for each, excess in searches if each["certified"]]
    wrong = sum(excess > WRONG for excess in certified)
    return f"{len(found)}/{len(searches)}, {sum(found)}, {len(certified)}, {wrong}"


def gain_from(row: Row, value: float) -> float:
    """By how much BIC falls from a value of the objective to the best, times N over n."""
    power = 2.0 if row["objective"] == "absolute" else 1.0
    return float(power * np.log(value / row["best"]) * row["samples"] / row["parameters"])


def gains_by_stage(rows: list[Row]) -> list[str]:
    """What searches gained from each stage on, beside the limit that a race assumes."""
    stages: dict[tuple[str, float], list[float]] = {
        ("first pass, few optima", AFTER_FEW_OPTIMA): [],
        ("first pass, many optima", AFTER_FIRST_PASS): [],
        ("batches of random points", AFTER_BATCHES): [],
        ("a restart after them", AFTER_RESTART): [],
    }
    few, many, batches, restart = stages.values()
    for row in rows:
        first, searched = row["first"], row["searches"][0]
        limit = gain_after_first_pass(first["undiscovered"])
        (few if limit == AFTER_FEW_OPTIMA else many).append(gain_from(row, first["value"]))
        minima, count = searched["minima"], searched["batches"]
        batches.append(gain_from(row, min(minima[:count])))
        if len(minima) > count:
            restart.append(gain_from(row, min(minima[: count + 1])))
    return [
        f"| {name} | {len(gained)} | {limit} | {sum(each > limit for each in gained)} "
        f"| {max(gained):.2g} |"
        for (name, limit), gained in stages.items()
    ]


def write_page(rows: list[Row]) -> None:
    cells = []
    for larger, orders in ((False, "true"), (True, "twice")):
        for objective in OBJECTIVES:
            of_case = [r for r in rows if r["larger"] == larger and r["objective"] == objective]
            others = [r for r in of_case if r["structure"] in OTHERS]
            rest = [r for r in of_case if r["structure"] not in OTHERS]
            cells.append([f"{orders}, {objective}", rates(rest), rates(others)])
    write_section(
        "search",
        "Certificates: polynomial models",
        f"{len(rows)} random problems, 400 to 1000 samples, noise of 5 and 50 %, each with "
        f"{len(SEEDS)} seeds and {EVALUATIONS} evaluations.\n*Found*: within 10⁻⁶ of the lowest "
        "value; *wrong*: certified and more than 10⁻⁴ above it. Values that no seed found hide "
        "errors.\nCells: found/searches, certified ones of the found, all certified, wrong ones.",
        "benchmarks/search_certificate.py",
        ("orders, objective", "ARMAX, ARARX, ARMA", "OE, BJ, ARARMAX"),
        cells,
    )
    print("| after | problems | limit | above it | most |", *gains_by_stage(rows), sep="\n")


def read(file: Path | None) -> list[Row]:
    """Runs of a calibration, as far as there are some."""
    if file is None or not file.exists():
        return []
    return [json.loads(line) for line in file.read_text().splitlines()]


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("file", type=Path)
    # Rules were made on the problems before.
    parser.add_argument("--first", type=int, default=2240)
    parser.add_argument("--problems", type=int, default=560)
    arguments = parser.parse_args()
    rows = read(arguments.file)
    done = {row["index"] for row in rows}
    with threadpool_limits(limits=1):
        for index in range(arguments.first, arguments.first + arguments.problems):
            if index not in done:
                rows.append(run(case_of(index)))
                with arguments.file.open("a") as sink:
                    sink.write(json.dumps(rows[-1]) + "\n")
    write_page(rows)


if __name__ == "__main__":
    main()
