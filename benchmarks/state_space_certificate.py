"""How often is a certified search for a state-space model wrong?

    python benchmarks/state_space_certificate.py FILE [--problems 96]

Prints the table of docs/evidence/state_space.md.  Each problem is a random truth of
``state_space.py`` and a record of it, of the true order or of one twice as large.  The search of
the workflow is compared with the best of it and of three others: the memetic search from random
points alone with another seed, without an early end and with ten times the evaluations (three
times where the search was not certified), a wide sweep of the orders up to this one, and at the
true order a descent from the truth.  FILE keeps the runs, one a line: those that it holds are not
computed again.
"""

from __future__ import annotations

import argparse
import json
import sys
import time
from pathlib import Path
from typing import NamedTuple

import numpy as np
from threadpoolctl import threadpool_limits

ROOT = Path(__file__).resolve().parent.parent
sys.path.insert(0, str(ROOT / "benchmarks"))
sys.path.insert(0, str(ROOT / "workflow" / "scripts"))

from search_certificate import NOISES, Row, read  # noqa: E402
from state_space import RATE, recorded, truth  # noqa: E402

from evopem import SearchSettings  # noqa: E402
from evopem.config.structures import STATE_SPACE_FORMS  # noqa: E402
from evopem.estimation.search.certificate import is_certified  # noqa: E402
from evopem.estimation.search.memetic import memetic_search  # noqa: E402
from evopem.estimation.search.problem import SearchDiagnostics  # noqa: E402
from evopem.estimation.state_space.estimate import estimate_state_space, estimates_of_orders  # noqa: E402
from evopem.estimation.state_space.local_estimates import (  # noqa: E402
    StateSpaceEstimate,
    StateSpaceTask,
    descend_from,
)
from evopem.estimation.state_space.problem import StateSpaceProblem  # noqa: E402
from evopem.estimation.state_space.search import MOST_EVALUATIONS  # noqa: E402
from evopem.models.state_space import StateSpaceModel  # noqa: E402
from evopem.signals.recording import Recording  # noqa: E402

CHANNELS = ((2, 2), (1, 3))
LENGTHS = (200, 500, 1000, 2000)
FORMS = {form: STATE_SPACE_FORMS[form] for form in ("ss", "ss_oe")}
# Relative distance above the best known value from which on a search is wrong.
WRONG = 1e-6
# Evaluations of the comparison, in those of a search, and where nothing was certified.
REFERENCE_FACTOR = 10
UNCERTIFIED_FACTOR = 3
# Estimates of each order that the wide sweep descends from.
SWEEP_WIDTH = 12


class Case(NamedTuple):
    """What a problem is made of."""

    index: int
    inputs: int
    outputs: int
    modes: int
    form: str
    samples: int
    noise: float
    larger: bool

    @property
    def order(self) -> int:
        """Number of states of the models that are searched."""
        return (4 if self.larger else 2) * self.modes


def case_of(index: int) -> Case:
    """Every combination in turn, lengths and numbers of modes at random."""
    generator = np.random.default_rng([2028, index])
    larger = bool(index // 8 % 2)
    samples = int(generator.choice(LENGTHS))
    most = 2 if larger or samples == LENGTHS[0] else 3
    return Case(
        index,
        *CHANNELS[index % 2],
        int(generator.integers(1, most + 1)),
        tuple(FORMS)[index // 2 % 2],
        samples,
        NOISES[index // 4 % 2],
        larger,
    )


def run(case: Case) -> Row:
    true = truth(case.inputs, case.outputs, case.modes, case.form, seed=1000 + case.index)
    u, y = recorded(true, case.samples, case.noise / 100.0, case.index)
    weighting = FORMS[case.form]
    began = time.process_time()
    found = estimate_state_space(
        Recording(u, y, RATE),
        case.order,
        structure=case.form,
        weighting=weighting,
    )
    seconds = time.process_time() - began
    diagnostics = found.search.diagnostics
    certified = is_certified(diagnostics, polynomial=False)
    others = {
        "random": from_random_points(u, y, case, certified),
        "sweep": swept(u, y, case).objective,
    }
    if not case.larger:
        others["truth"] = from_truth(true, u, y, weighting)
    return {
        **case._asdict(),
        "order": case.order,
        "default": {
            "value": found.objective,
            "evaluations": diagnostics.evaluations,
            "minima": diagnostics.restart_minima,
            "confirming": diagnostics.n_confirming,
            "undiscovered": diagnostics.undiscovered_probability,
            "seconds": seconds,
        },
        "others": others,
        "best": min(found.objective, *others.values()),
        "reference_seconds": time.process_time() - began - seconds,
    }


def from_random_points(u: np.ndarray, y: np.ndarray, case: Case, certified: bool) -> float:
    """The lowest value of many restarts, none of which has estimates to begin with."""
    recording = Recording(u, y, RATE)
    task = StateSpaceTask(case.form, weighting=FORMS[case.form])
    errors = task.errors(recording, case.order)
    search = StateSpaceProblem(errors)
    factor = REFERENCE_FACTOR if certified else UNCERTIFIED_FACTOR
    sizes = SearchSettings(
        mu=8, lambda_=16, nu=6, refine="random", evaluations=factor * MOST_EVALUATIONS
    )
    # More restarts than evaluations never agree: the search spends all of these.
    generator = np.random.default_rng([case.index, 2])
    never = sizes.evaluations + 1
    return memetic_search(search, sizes, generator, agreeing_restarts=never).value


def swept(u: np.ndarray, y: np.ndarray, case: Case) -> StateSpaceEstimate:
    """The estimate of a ladder over all smaller orders, with another seed."""
    *_, largest = estimates_of_orders(
        Recording(u, y, RATE),
        range(1, case.order + 1),
        structure=case.form,
        weighting=FORMS[case.form],
        settings=SearchSettings(objective="quadratic", seed=2),
        width=SWEEP_WIDTH,
    )
    return largest


def from_truth(true: StateSpaceModel, u: np.ndarray, y: np.ndarray, weighting: str) -> float:
    """The value at the optimum that a descent from the truth ends at."""
    task = StateSpaceTask(weighting=weighting)
    try:
        return descend_from(true, Recording(u, y, RATE), task).objective
    except ValueError:
        return np.inf


def judged(row: Row) -> Row:
    """A row with the certificate of today's rule, whichever it was when the search ran."""
    found = row["default"]
    diagnostics = SearchDiagnostics(
        evaluations=found["evaluations"],
        generations=0,
        restart_minima=tuple(found["minima"]),
        n_confirming=found["confirming"],
        n_local_optima=0,
        n_multistart=0,
        undiscovered_probability=found["undiscovered"],
        convergence=(),
    )
    return row | {"default": found | {"certified": is_certified(diagnostics, polynomial=False)}}


def rates(rows: list[Row]) -> str:
    """Certified searches, wrong ones, uncertified ones above the best value, the most of these."""
    excesses = [(row["default"], row["default"]["value"] / row["best"] - 1.0) for row in rows]
    certified = [excess for found, excess in excesses if found["certified"]]
    others = [excess for found, excess in excesses if not found["certified"]]
    wrong, above = (sum(each > WRONG for each in kind) for kind in (certified, others))
    most = f"{100 * max(others):.2g}" if others else "–"
    return f"{len(certified)}/{len(rows)}, {wrong}, {above}/{len(others)}, {most}"


def print_table(rows: list[Row]) -> None:
    rows = [judged(row) for row in rows]
    print(
        "| order | form | problems | certified | of them wrong | others above | median | 95 % "
        "| most |"
    )
    print("|---|---|---|---|---|---|---|---|---|")
    for larger in (False, True):
        for form in FORMS:
            own = [row for row in rows if row["larger"] == larger and row["form"] == form]
            if own:
                order = "twice the true one" if larger else "true"
                print(f"| {order} | {form} | {rates(own)} |")
    print(f"| all | both | {rates(rows)} |")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("file", type=Path)
    parser.add_argument("--problems", type=int, default=96)
    arguments = parser.parse_args()
    rows = read(arguments.file)
    done = {row["index"] for row in rows}
    with threadpool_limits(limits=1):
        cases = [case_of(index) for index in range(arguments.problems)]
        # Short records first: they take the least time.
        for case in sorted(cases, key=lambda case: case.samples):
            if case.index not in done:
                rows.append(run(case))
                with arguments.file.open("a") as sink:
                    sink.write(json.dumps(rows[-1]) + "\n")
    print_table(rows)


if __name__ == "__main__":
    main()
