"""How often is a certified search wrong?  Writes its section of docs/evidence/search.md.

    python benchmarks/search_certificate.py FILE [--problems 500] [--earlier FILE]

Each problem is a random model of one of several structures, a record of it, and orders that are
those of the model or twice as large.  The default search, and one with the evaluations of a
repeated search, are compared with the best that other seeds and ten times the evaluations find,
without an early end.  FILE keeps the runs, one a line: those that it holds are not computed again.
The best values of an earlier calibration, of another search, count as well where they are given.
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
sys.path.insert(0, str(ROOT / "workflow" / "scripts"))

from evopem import PolynomialModel, SearchSettings  # noqa: E402
from evopem.estimation.order_selection import REPEAT_FACTOR  # noqa: E402
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
from evopem.synthesis.armax import polynomial_record  # noqa: E402

Row = dict[str, Any]
Array = NDArray[np.float64]

# Half of the problems are ARMAX models.
STRUCTURES = ("armax",) * 5 + ("oe", "bj", "arma", "ararx", "ararmax")
LENGTHS = (200, 500, 1000, 2000, 4000)
NOISES = (5.0, 50.0)
OBJECTIVES = ("quadratic", "absolute")
# Relative distance above the best known value from which on a search is wrong.
WRONG = 1e-6
EVALUATIONS = SearchSettings().evaluations
REFERENCE_FACTOR = 10
STRIDE = 7
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


def orders_of_case(case: Case, truth: PolynomialModel) -> Orders:
    o = truth.orders
    factor = 2 if case.larger else 1
    names = {name: factor * getattr(o.single, name) for name in ("na", "nb", "nc", "nd", "nf")}
    given = {name: order for name, order in names.items() if order}
    return orders_of(case.structure, given | ({"nk": o.single.nk} if o.single.nk else {}))


def problem_of(case: Case) -> tuple[PolynomialProblem, Orders]:
    generator = np.random.default_rng([2027, case.index])
    truth = truth_of(case, generator)
    u, y, _ = polynomial_record(truth, case.samples, case.noise, generator)
    orders = orders_of_case(case, truth)
    settings = SearchSettings(objective=case.objective)
    window = default_window(orders, settings)
    errors = prediction_errors(Recording(u, y, 1.0), orders, settings, window, False)
    return PolynomialProblem(scaled_errors(errors)[0]), orders


def search(case: Case, seed: int, evaluations: int, known_minimum: float = np.inf) -> Row:
    problem, _ = problem_of(case)
    settings = SearchSettings(objective=case.objective, evaluations=evaluations)
    generator = np.random.default_rng([case.index, seed])
    began = time.process_time()
    found = global_search(problem, settings, generator, None, known_minimum)
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
    }


def run(case: Case, known: float) -> Row:
    _, orders = problem_of(case)
    default = search(case, 1, EVALUATIONS)
    repeated = default if default["certified"] else search(case, 1, REPEAT_FACTOR * EVALUATIONS)
    # No restart can agree with a value of 0: the search spends all its evaluations.
    reference = search(case, 2, REFERENCE_FACTOR * default["evaluations"], known_minimum=0.0)
    return {
        **case._asdict(),
        "orders": str(orders),
        "parameters": orders.parameters,
        "first": search(case, 3, FIRST_PASS),
        "default": default,
        "repeated": repeated,
        "best": min(known, *(each["value"] for each in (default, repeated, reference))),
    }


def excess(row: Row, kind: str) -> float:
    """How far a search ended above the best known value, relative."""
    return float(row[kind]["value"] / row["best"] - 1.0)


def rates(rows: list[Row], kind: str) -> str:
    """Certified searches, wrong ones, uncertified ones above the best value, the most of these."""
    certified = [excess(row, kind) for row in rows if row[kind]["certified"]]
    others = [excess(row, kind) for row in rows if not row[kind]["certified"]]
    wrong = sum(each > WRONG for each in certified)
    above = sum(each > WRONG for each in others)
    most = f"{100 * max(others):.2g}" if others else "–"
    return f"{len(certified)}/{len(rows)}, {wrong}, {above}/{len(others)}, {most}"


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
        first, repeated = row["first"], row["repeated"]
        limit = gain_after_first_pass(first["undiscovered"])
        (few if limit == AFTER_FEW_OPTIMA else many).append(gain_from(row, first["value"]))
        minima, count = repeated["minima"], repeated["batches"]
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
            cells.append(
                [f"{orders}, {objective}", *(rates(of_case, k) for k in ("default", "repeated"))]
            )
    write_section(
        "search",
        "Certificates: polynomial models",
        f"{len(rows)} random problems: ARMAX (half), OE, BJ, ARMA, ARARX and ARARMAX, 200 to 4000 "
        "samples, noise of 5 and 50 %. *Wrong*: the objective is more\nthan 10⁻⁶ above the best of "
        "it, of searches with another seed and of ten times the evaluations; a reference that is "
        "not the lowest hides errors.\nCells: certified searches, wrong ones, searches without a "
        "certificate above it, and the most of these, percent.",
        "benchmarks/search_certificate.py",
        ("orders, objective", f"{EVALUATIONS} evaluations", str(REPEAT_FACTOR * EVALUATIONS)),
        [*cells, ["all", "–", rates(rows, "repeated")]],
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
    parser.add_argument("--problems", type=int, default=500)
    parser.add_argument("--earlier", type=Path)
    arguments = parser.parse_args()
    rows = read(arguments.file)
    known = {row["index"]: row["best"] for row in read(arguments.earlier)}
    done = {row["index"] for row in rows}
    with threadpool_limits(limits=1):
        # Neighbouring numbers share structure and objective: a part of the problems is mixed so.
        for index in range(0, STRIDE * arguments.problems, STRIDE):
            if index not in done:
                rows.append(run(case_of(index), known.get(index, np.inf)))
                with arguments.file.open("a") as sink:
                    sink.write(json.dumps(rows[-1]) + "\n")
    write_page(rows)


if __name__ == "__main__":
    main()
