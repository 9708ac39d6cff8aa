"""How often each check of the report fails on models of the true orders.

    python benchmarks/check_false_alarms.py [--records 200]

Every record has a truth of its own, an ARMAX(4,4,3,1) with poles and zeros drawn at random, white
input, 2000 samples, and noise of 0.05, 1 or 20 times the standard deviation of the response. The
model has the true orders. The checks of the order search are left out, since no order is searched.
Prints a table in Markdown.
"""

import argparse
import sys
from collections import Counter
from pathlib import Path

import numpy as np
from scipy.signal import lfilter

sys.path.insert(0, str(Path(__file__).parents[1] / "workflow" / "scripts"))

from evopem.config.settings import (
    PreparationSettings,
    ScoringWindow,
    SearchSettings,
    SplitSettings,
    TransformSettings,
)
from evopem.estimation.model_record import ModelRecord
from evopem.estimation.order_candidate import PhaseSelection
from evopem.estimation.order_selection import OrderSearch, complete_estimate, estimate_candidates
from evopem.models.orders import armax_orders
from evopem.signals.preparation import prepare
from evopem.signals.recording import Recording
from evopem.signals.recording_info import describe_recording
from evopem.validation.checks import Check, Evidence, checks
from evopem.validation.checks.search import ranges_of_phases
from evopem.validation.validate import validate

ORDERS, WINDOW, SAMPLES = armax_orders(4, 4, 3, 1), ScoringWindow(10, 30), 2000
PREPARATION = PreparationSettings(TransformSettings("none", 0, 0), SplitSettings(0, 0.8))
NOISE = (0.05, 1.0, 20.0)
OF_THE_ORDER_SEARCH = ("Orders inside their search ranges",)


def random_polynomial(generator: np.random.Generator, degree: int, radius: float) -> np.ndarray:
    """A monic polynomial with pairs of roots, and a real one, of radius 0.3 to ``radius``."""
    roots = []
    while len(roots) + 1 < degree:
        root = generator.uniform(0.3, radius) * np.exp(1j * generator.uniform(0.2, 2.9))
        roots += [root, root.conjugate()]
    if len(roots) < degree:
        roots.append(generator.uniform(-0.8, 0.8))
    return np.real(np.poly(roots))


def judged(seed: int, noise: float, objective: str) -> list[Check]:
    """The checks of the model of one record."""
    key = (round(100 * noise), objective == "absolute")
    generator = np.random.default_rng(np.random.SeedSequence(seed, spawn_key=key))
    a, c = (random_polynomial(generator, n, r) for n, r in ((4, 0.97), (3, 0.8)))
    b = np.concatenate([[0.0], generator.standard_normal(4)])
    u = generator.standard_normal(SAMPLES + 500)
    response = lfilter(b, a, u)
    disturbance = lfilter(c, a, generator.standard_normal(SAMPLES + 500))
    y = response + noise * np.std(response) / np.std(disturbance) * disturbance
    recording = Recording(u[500:], y[500:], 100.0)
    prepared = prepare(recording, PREPARATION)
    data = prepared.estimation
    settings = SearchSettings(objective=objective, evaluations=10000)
    (candidate,) = estimate_candidates(OrderSearch(data, settings, WINDOW), [ORDERS], "nb")
    found = complete_estimate(candidate, data, settings, WINDOW)
    record = ModelRecord.of(found, data, settings, prepared.transforms)
    validation, _ = validate(found.model, prepared, objective)
    phases = {
        phase: PhaseSelection(phase, ORDERS, "", (candidate,))
        for phase in ("delay", "plant", "nc", "nb")
    }
    ranges = ranges_of_phases(phases)
    return checks(Evidence(record, validation, describe_recording(recording), ranges))


def main() -> None:
    parser = argparse.ArgumentParser()
    parser.add_argument("--records", type=int, default=200)
    records = parser.parse_args().records
    print("| check | objective | " + " | ".join(f"noise / response {n:g}" for n in NOISE) + " |")
    print("|---|---|" + "---|" * len(NOISE))
    for objective in ("quadratic", "absolute"):
        failed = {noise: Counter() for noise in NOISE}
        unjudged = {noise: Counter() for noise in NOISE}
        names: dict[str, None] = {}
        for noise in NOISE:
            for seed in range(records):
                for check in judged(seed, noise, objective):
                    names.setdefault(check.name)
                    failed[noise][check.name] += check.passed is False
                    unjudged[noise][check.name] += check.passed is None
        for name in names:
            if name in OF_THE_ORDER_SEARCH:
                continue
            cells = []
            for noise in NOISE:
                share = 100 * failed[noise][name] / records
                open_ = 100 * unjudged[noise][name] / records
                cells.append(f"{share:.1f} %" + (f" ({open_:.1f} % not judged)" if open_ else ""))
            print(f"| {name} | {objective} | " + " | ".join(cells) + " |", flush=True)


if __name__ == "__main__":
    main()
