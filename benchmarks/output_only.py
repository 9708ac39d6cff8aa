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
sys.path.insert(0, str(ROOT / "workflow" / "scripts"))

from evopem import SearchSettings, estimate  # noqa: E402
from evopem.estimation.state_space.estimate import sweep_state_space_orders  # noqa: E402
from evopem.synthesis.vibrating_structure import VibratingStructure  # noqa: E402

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
        hits: dict[str, list[bool]] = {"frequency": [], "damping": [], "shape": []}
        missed = 0
        for record in range(records):
            generator = np.random.default_rng(np.random.SeedSequence(21, spawn_key=(record,)))
            y = structure.ambient_record(2000, RATE, 0.15, generator)
            if kind.startswith("arma"):
                settings = SearchSettings(objective="quadratic")
                modes = estimate(
                    None, y[:, 0], (order, order), RATE, structure="arma", settings=settings
                ).model.modes()
            else:
                scores = sweep_state_space_orders(None, y, [order], RATE, folds=False)
                modes = scores.estimates[0].model.modes()
            for k, frequency in enumerate(structure.frequencies_hz):
                near = [m for m in modes if abs(m.frequency_hz - frequency) < 0.04 * frequency]
                if not near:
                    missed += 1
                    continue
                shape = structure.shapes[:, k]
                mode = min(near, key=lambda m: abs(m.frequency_hz - frequency))
                hits["frequency"].append(
                    abs(mode.frequency_hz - frequency) < 1.96 * mode.frequency_se_hz
                )
                hits["damping"].append(
                    abs(mode.damping_ratio - structure.damping_ratios[k]) < 1.96 * mode.damping_se
                )
                if kind.startswith("arma"):
                    continue
                one = int(np.argmax(np.abs(mode.shape)))
                difference = mode.shape - shape / shape[one]
                for j in np.delete(np.arange(len(shape)), one):
                    hits["shape"] += [
                        abs(difference[j].real) < 1.96 * mode.shape_se_real[j],
                        abs(difference[j].imag) < 1.96 * mode.shape_se_imag[j],
                    ]
        shares = [f"{100 * np.mean(hits[name]):.1f} %" if hits[name] else "–" for name in hits]
        print(f"| {kind} | {order} | {records} | {' | '.join(shares)} | {missed} |", flush=True)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--records", type=int, default=200)
    coverage(parser.parse_args().records)


if __name__ == "__main__":
    main()
