"""How often are the delays of several inputs right?  docs/evidence/state_space.md has the table.

    python benchmarks/input_delays.py [--records 34] [--first 1000]

Records of the kinds of ``random_plants.py``, in which every input acts one sample later,
shifted so that each input acts after 0 to 5 samples, by chance.  Nothing but the delays is
decided, as the workflow decides them, from the first samples of each record.  A delay that is too
short costs states; one that is too long leaves out lags that act.
"""

from __future__ import annotations

import argparse
from collections import defaultdict
from collections.abc import Iterator

import numpy as np
from random_plants import KINDS, record, recording_of
from threadpoolctl import threadpool_limits

from evopem.estimation.delays import estimate_delays

LENGTHS = (200, 500, 1000)
# Delays of the inputs, and the largest of them.
LARGEST = 5
# Share of noise in the outputs that divides the records.
NOISY = 0.3


def shifted(
    u: np.ndarray, y: np.ndarray, generator: np.random.Generator
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Inputs that act after random delays, the outputs of the same samples, and the delays."""
    delays = generator.integers(0, LARGEST + 1, u.shape[1])
    rows = np.arange(1, len(u) - LARGEST)
    columns = [u[rows + delay - 1, k] for k, delay in enumerate(delays)]
    return np.column_stack(columns), y[rows], delays


def decisions(kind: str, seed: int) -> Iterator[tuple[int, float, np.ndarray]]:
    """For each length: share of noise, and found less true delays, (nu,)."""
    made = record(kind, seed)
    generator = np.random.default_rng(np.random.SeedSequence(23, spawn_key=(seed,)))
    u, y, delays = shifted(made["u"], made["y"], generator)
    for samples in LENGTHS:
        found = estimate_delays(recording_of(u[:samples], y[:samples]))
        yield samples, made["share"], np.array(found) - delays


def print_table(first: int, records: int) -> None:
    """Rows by kind and length, and by length and noise of all kinds together."""
    errors: dict[tuple[str, int, str], list[int]] = defaultdict(list)
    for kind in KINDS:
        for seed in range(first, first + records):
            for samples, share, error in decisions(kind, seed):
                noise = "10 to 30 %" if share <= NOISY else "30 to 50 %"
                errors[kind, samples, "10 to 50 %"].extend(error)
                errors["all", samples, noise].extend(error)
    print("| records | samples | noise | inputs | right | too short | too long | most too long |")
    print("|---|---|---|---|---|---|---|---|")
    for kind in (*KINDS, "all"):
        for (_, samples, noise), each in sorted(
            item for item in errors.items() if item[0][0] == kind
        ):
            error = np.array(each)
            shares = [100 * np.mean(kept) for kept in (error == 0, error < 0, error > 0)]
            print(
                f"| {kind} | {samples} | {noise} | {len(error)} | "
                f"{' | '.join(f'{share:.1f} %' for share in shares)} | {max(error.max(), 0)} |"
            )


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--records", type=int, default=34, help="of each kind")
    parser.add_argument("--first", type=int, default=1000, help="seed of the first one")
    arguments = parser.parse_args()
    with threadpool_limits(limits=1, user_api="blas"):
        print_table(arguments.first, arguments.records)


if __name__ == "__main__":
    main()
