"""Measure intervals of output-only identification; docs/evidence/output_only.md has the results.

    python benchmarks/output_only.py [--records 200]

Records of a structure with four modes, two of them close, under unmeasured forces, with 15 % of
sensor noise; the order is known.  benchmarks/modes_to_trust.py counts false and missed modes.
"""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

import numpy as np

ROOT = Path(__file__).resolve().parent.parent
sys.path[:0] = [str(ROOT / "workflow" / "scripts"), str(ROOT / "tests")]

from covered_intervals import CoveredIntervals  # noqa: E402
from vibrating_structure import VibratingStructure  # noqa: E402

from evopem import SearchSettings, estimate  # noqa: E402
from evopem.estimation.state_space.estimate import estimates_of_orders  # noqa: E402
from evopem.signals.recording import recording_of  # noqa: E402

RATE = 100.0


def coverage(records: int) -> None:
    """Print the share of 95 % intervals that cover the truth, order known."""
    mixed = np.array([[1.0, 0.5, 0.2, -0.6], [0.6, -1.0, 0.5, 0.3], [0.3, 0.4, -1.0, 0.8]])
    close = VibratingStructure(
        np.array([4.0, 9.0, 9.5, 21.0]), np.array([0.02, 0.015, 0.015, 0.01]), mixed
    )
    apart = VibratingStructure(
        np.array([4.0, 9.0, 21.0]), np.array([0.02, 0.015, 0.01]), mixed[:, [0, 1, 3]]
    )
    for kind, structure, order in (
        ("state space, 3 outputs", close, 8),
        ("arma, 1 output", apart, 6),
    ):
        counted = CoveredIntervals()
        for record in range(records):
            generator = np.random.default_rng(np.random.SeedSequence(21, spawn_key=(record,)))
            y = structure.ambient_record(2000, RATE, 0.15, generator)
            arma = kind.startswith("arma")
            if arma:
                settings = SearchSettings(objective="quadratic")
                modes = estimate(
                    None, y[:, 0], (order, order), RATE, structure="arma", settings=settings
                ).model.modes()
            else:
                (estimated,) = estimates_of_orders(recording_of(None, y, RATE), [order])
                modes = estimated.model.modes()
            counted.begin_record()
            truths = zip(
                structure.frequencies_hz,
                structure.damping_ratios,
                structure.shapes.T,
                strict=True,
            )
            for frequency, damping, shape in truths:
                near = [m for m in modes if abs(m.frequency_hz - frequency) < 0.04 * frequency]
                mode = min(near, key=lambda m: abs(m.frequency_hz - frequency), default=None)
                counted.add(mode, frequency, damping, () if arma else shape)
        print(f"| {kind} | {order} | {records} | {counted.cells()} |", flush=True)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--records", type=int, default=200)
    coverage(parser.parse_args().records)


if __name__ == "__main__":
    main()
