"""Follow the modes of fleets of synthetic recordings; docs/evidence/output_only.md has the results.

    python benchmarks/following_modes.py [--recordings 200] [--unchanged 1]
    python benchmarks/following_modes.py --sequences

Each recording is one of the velocities of a structure with three sensors and four modes, two of
them close, under unmeasured forces, with 15 % of sensor noise.  In the first fleet all stiffnesses
drop by 2 % half-way, so that all frequencies drop by 1 %; in the others nothing changes.
With ``--sequences``, shares of false alarms over sequences of independent estimates instead.
"""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

import numpy as np

ROOT = Path(__file__).resolve().parent.parent
sys.path[:0] = [str(ROOT / "workflow" / "scripts"), str(ROOT / "tests")]

from vibrating_structure import VibratingStructure  # noqa: E402

from evopem.estimation.state_space.estimate import estimates_of_orders  # noqa: E402
from evopem.models.modes import Mode  # noqa: E402
from evopem.report.index_page import movements  # noqa: E402
from evopem.results.followed_modes import follow_modes  # noqa: E402
from evopem.signals.recording import recording_of  # noqa: E402

RATE, SAMPLES, ORDER = 100.0, 2000, 8
SHAPES = np.array([[1.0, 0.5, 0.2, -0.6], [0.6, -1.0, 0.5, 0.3], [0.3, 0.4, -1.0, 0.8]])
STRUCTURE = VibratingStructure(
    np.array([4.0, 9.0, 9.5, 21.0]), np.array([0.02, 0.015, 0.015, 0.01]), SHAPES
)


def recorded_modes(structure: VibratingStructure, fleet: int, number: int) -> list[Mode]:
    """The modes of one recording, order known; those damped by more than 20 % are not trusted."""
    generator = np.random.default_rng(np.random.SeedSequence(22, spawn_key=(fleet, number)))
    y = structure.ambient_record(SAMPLES, RATE, 0.15, generator)
    (estimated,) = estimates_of_orders(recording_of(None, y, RATE), [ORDER], width=3)
    return [mode for mode in estimated.model.modes() if mode.damping_ratio < 0.2]


def told(values: np.ndarray, errors: np.ndarray) -> list[str]:
    """What is told of a mode that was estimated again and again."""
    recordings = {
        f"r{place:04d}": [Mode(100.0 + value, 0.02, 0.9 + 0.1j, error, 0.002)]
        for place, (value, error) in enumerate(zip(values, errors, strict=True))
    }
    return [sentence for mode in follow_modes(recordings) for sentence in movements(mode)]


def sequences() -> None:
    """Print false alarms without a change, and how often changes are told as what they are."""
    generator = np.random.default_rng(0)
    for count in (4, 6, 10, 30, 200):
        repeats = 1000 if count < 100 else 200
        for scatter in (0.0, 1.0, 3.0):
            alarms = 0
            for _ in range(repeats):
                errors = generator.uniform(0.5, 1.5, count)
                deviations = np.hypot(errors, scatter)
                alarms += bool(
                    told(0.01 * deviations * generator.standard_normal(count), 0.01 * errors)
                )
            print(
                f"{count} estimates, scatter {scatter:g}: {100 * alarms / repeats:.1f} %",
                flush=True,
            )
    for count in (13, 40):
        line, wave = np.linspace(-0.5, 0.5, count), np.sin(2 * np.pi * np.arange(count) / 8)
        step = 1.0 * (np.arange(count) >= count // 2)
        for word, course in (("trend", line), ("oscillates", wave), ("moved by", step)):
            for size in (2.0, 4.0, 6.0):
                found = 0
                for _ in range(200):
                    values = size * course + generator.standard_normal(count)
                    found += any(word in each for each in told(0.01 * values, np.full(count, 0.01)))
                print(f"{word}, {count} estimates, {size:g} errors: {found / 2:.0f} %", flush=True)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--recordings", type=int, default=200)
    parser.add_argument("--unchanged", type=int, default=1)
    parser.add_argument("--sequences", action="store_true")
    arguments = parser.parse_args()
    if arguments.sequences:
        sequences()
        return
    count = arguments.recordings
    for fleet in range(1 + arguments.unchanged):
        recordings = {}
        for number in range(1, count + 1):
            softened = fleet == 0 and number > count // 2
            structure = STRUCTURE.softened(0.98) if softened else STRUCTURE
            recordings[f"r{number:03d}"] = recorded_modes(structure, fleet, number)
        what = f"drop of 2 % from r{count // 2 + 1:03d} on" if fleet == 0 else "nothing changes"
        print(f"fleet {fleet}, {what}")
        for mode in follow_modes(recordings):
            error = np.median([each.frequency_se_hz for each in mode.modes])
            print(
                f"  mode {mode.number}: {mode.frequency_hz:.3f} Hz in {len(mode.modes)}, "
                f"standard error {100 * error / mode.frequency_hz:.2f} %, "
                f"{' '.join(movements(mode)) or 'no warning'}",
                flush=True,
            )


if __name__ == "__main__":
    main()
