"""Absolute against quadratic objective under outliers; writes docs/evidence/outliers.{md,svg}.

    python benchmarks/outliers.py [--records 40] [--processes 2]

Records of the ARMAX(7,6,7,3) truth at its orders, a share of whose samples are hit: in the
innovations, whose outliers the system itself filters, or on the measured output alone.  An
outlier is ten standard deviations of the innovations, of either sign; a spike, as of a loose
contact, ten standard deviations of the output.
"""

from __future__ import annotations

import argparse
import sys
from concurrent.futures import ProcessPoolExecutor
from dataclasses import replace
from functools import partial
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np
from evidence import FOLDER, write_section
from numpy.typing import NDArray
from scipy.signal import lfilter

ROOT = Path(__file__).resolve().parent.parent
sys.path.insert(0, str(ROOT / "workflow" / "scripts"))

from evopem import SearchSettings, estimate  # noqa: E402
from evopem.synthesis import true_model  # noqa: E402

Array = NDArray[np.float64]

PLACES = ("innovations", "measured output", "measured output, spikes")
SHARES = (0.0, 0.01, 0.05, 0.1)
OBJECTIVES = ("absolute", "quadratic")
SIZE = 10.0
SAMPLES, WARM_UP, NOISE_RATIO = 2000, 2000, 0.1
# At the true orders a few descents find the optimum.
SEARCH = SearchSettings(mu=4, lambda_=4, nu=4, evaluations=2500)


def errors_of(seed: int, place: str, share: float) -> Array:
    """Per objective: simulation error and largest errors of fn and damping, all in percent."""
    truth = true_model()
    key = (PLACES.index(place), round(1000 * share))
    generator = np.random.default_rng(np.random.SeedSequence(seed, spawn_key=key))
    total = SAMPLES + WARM_UP
    u = generator.standard_normal(total)
    clean = truth.simulate(u)
    deviation = NOISE_RATIO * np.std(clean[WARM_UP:])
    e = deviation * generator.standard_normal(total)
    hits = generator.random(total) < share
    size = SIZE * (np.std(clean[WARM_UP:]) if place == PLACES[2] else deviation)
    outliers = np.where(hits, size * generator.choice([-1.0, 1.0], total), 0.0)
    y = clean + lfilter(truth.C, truth.A, e + outliers * (place == PLACES[0]))
    y += outliers * (place != PLACES[0])
    rows = []
    for objective in OBJECTIVES:
        settings = replace(SEARCH, objective=objective)
        model = estimate(u[WARM_UP:], y[WARM_UP:], truth.orders, 100.0, settings=settings).model
        simulated = model.simulate(u)[WARM_UP:]
        true = clean[WARM_UP:]
        pairs = [
            (min(model.modes(), key=lambda m: abs(m.frequency_hz - t.frequency_hz)), t)
            for t in truth.modes()
        ]
        rows.append(
            [
                np.linalg.norm(simulated - true) / np.linalg.norm(true),
                max(abs(m.frequency_hz / t.frequency_hz - 1.0) for m, t in pairs),
                max(abs(m.damping_ratio / t.damping_ratio - 1.0) for m, t in pairs),
            ]
        )
    return 100.0 * np.array(rows)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--records", type=int, default=40)
    parser.add_argument("--processes", type=int, default=2)
    arguments = parser.parse_args()
    medians = {}
    with ProcessPoolExecutor(arguments.processes) as pool:
        for place in PLACES:
            for share in SHARES:
                run = partial(errors_of, place=place, share=share)
                errors = np.array(list(pool.map(run, range(arguments.records))))
                for column, objective in enumerate(OBJECTIVES):
                    medians[place, share, objective] = np.median(errors[:, column], axis=0)
                print(
                    place, share, [medians[place, share, each] for each in OBJECTIVES], flush=True
                )
    rows = [
        [
            place,
            *(
                "/".join(f"{medians[place, share, each][0]:.3g}" for each in OBJECTIVES)
                for share in SHARES
            ),
        ]
        for place in PLACES
    ]
    write_section(
        "outliers",
        "Polynomial models",
        "Median simulation error against the noise-free output, percent, absolute/quadratic "
        f"objective; {arguments.records} records of {SAMPLES} samples of\nARMAX(7,6,7,3) at its "
        "orders, innovations 10 % of the output. A share of the samples has outliers of ten "
        "standard deviations of the\ninnovations, *spikes* of ten of the output; smaller ones "
        "were not tested.",
        "benchmarks/outliers.py",
        ("outliers in", *(f"{100 * share:.0f} %" for share in SHARES)),
        rows,
        "![Simulation error against the share of outliers](outliers.svg)",
    )
    draw(medians, FOLDER / "outliers.svg")


def draw(medians: dict[tuple[str, float, str], Array], file: Path) -> None:
    """Simulation error over the share of outliers, one panel for each place."""
    plt.rcParams["svg.hashsalt"] = "evopem"
    figure, axes = plt.subplots(1, 3, figsize=(10, 3.2), layout="constrained")
    for axis, place in zip(axes, PLACES, strict=True):
        for objective, marker in zip(OBJECTIVES, "os", strict=True):
            errors = [medians[place, share, objective][0] for share in SHARES]
            axis.plot(100 * np.array(SHARES), errors, marker=marker, label=objective)
        axis.set(title=place.capitalize(), xlabel="Share of samples (%)", ylim=(0, None))
        axis.grid(alpha=0.3)
    axes[0].set(ylabel="Median simulation error (%)")
    axes[0].legend(title="Objective")
    figure.savefig(file, metadata={"Date": None})


if __name__ == "__main__":
    main()
