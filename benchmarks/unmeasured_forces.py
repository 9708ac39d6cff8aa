"""Find and trust modes under coloured forces; docs/evidence/output_only.md has the results.

    python benchmarks/unmeasured_forces.py masts|colours FOLDER RECORD...
    python benchmarks/unmeasured_forces.py evidence FOLDER

``masts``: 8 to 11 modes of 0.2 to 1 % damping, some in close pairs, accelerations or velocities of
six sensors at 32 Hz with 5 % of noise, behind an anti-aliasing filter.  ``colours``: four modes of
0.5 to 15 % damping at four sensors; forces at one place or at all are coloured by a resonance of 3
to 60 % damping or a low-pass filter.  The order search of the automatic recipe, the table of modes.
"""

from __future__ import annotations

import json
import sys
import time
from dataclasses import replace
from pathlib import Path

import numpy as np

ROOT = Path(__file__).resolve().parent.parent
sys.path[:0] = [str(ROOT / "workflow" / "scripts"), str(ROOT / "tests"), str(ROOT / "benchmarks")]

from evidence import write_section  # noqa: E402
from modes_to_trust import paired  # noqa: E402
from vibrating_structure import random_frequencies  # noqa: E402

RATE = 32.0
# Modes, samples, colour and whether accelerations are measured, of each mast.
MASTS = (
    (8, 4000, "white", True),
    (11, 5000, "white", True),
    (9, 5000, "lowpass", True),
    (10, 5000, "resonance", False),
    (11, 5000, "lowpass", False),
    (8, 4000, "resonance", True),
)


def coloured(force, kind, rate, frequency, damping):  # type: ignore[no-untyped-def]
    """White forces through a resonance, or a low-pass filter of a time constant of 80 ms."""
    from scipy.signal import lfilter

    if kind == "white":
        return force
    w = 2.0 * np.pi * frequency / rate
    pole = np.exp(w * (-damping + 1j * np.sqrt(max(1.0 - damping**2, 0.0))))
    a = [1.0, -np.exp(-4.0 * np.pi / rate)] if kind == "lowpass" else np.poly([pole, pole.conj()])
    shaped = lfilter([1.0], np.real(a), force, axis=0)
    return shaped / shaped.std(axis=0) + 0.15 * force


def modal(force, frequency, damping, rate, accelerations):  # type: ignore[no-untyped-def]
    """Velocity or acceleration of a mode under a modal force held between samples."""
    from scipy.signal import cont2discrete, lfilter, ss2tf

    w = 2.0 * np.pi * frequency
    a, b = np.array([[0.0, 1.0], [-(w**2), -2.0 * damping * w]]), np.array([[0.0], [1.0]])
    c, d = (a[1:], np.eye(1)) if accelerations else (np.array([[0.0, 1.0]]), np.zeros((1, 1)))
    numerator, denominator = ss2tf(*cont2discrete((a, b, c, d), 1.0 / rate)[:4])
    return lfilter(numerator[0], denominator, force)


def structure(generator, modes, band_hz, dampings, close, sensors):  # type: ignore[no-untyped-def]
    """Random frequencies, some with a close neighbour, damping ratios and unit shapes."""
    frequencies = random_frequencies(generator, modes, close, band_hz)
    shapes = generator.standard_normal((sensors, modes))
    return {
        "frequencies_hz": frequencies,
        "damping_ratios": np.exp(generator.uniform(*np.log(dampings), modes)),
        "shapes": shapes / np.linalg.norm(shapes, axis=0),
    }


def mast(number):  # type: ignore[no-untyped-def]
    """Outputs and truth of a mast."""
    from scipy.signal import firwin, lfilter

    generator = np.random.default_rng([77, number])
    modes, samples, kind, accelerations = MASTS[number]
    truth = structure(generator, modes, (0.6, 14.0), (0.002, 0.01), 3, 6)
    rate, run_in = 8 * RATE, 32_000
    force = generator.standard_normal((run_in + 8 * samples, 6))
    force = coloured(force, kind, rate, 6.0, 0.38)
    y = np.zeros((len(force), 6))
    for f, z, shape in zip(*list(truth.values())[:2], truth["shapes"].T, strict=True):
        response = modal(force @ shape, f, z, rate, accelerations)
        scale = generator.uniform(0.4, 1.5) / response[run_in:].std()
        y += np.outer(scale * response, shape)
    y = lfilter(firwin(161, 30.8 / rate), [1.0], y, axis=0)[run_in::8]
    return y + 0.05 * y.std(axis=0) * generator.standard_normal(y.shape), truth


def colour(number):  # type: ignore[no-untyped-def]
    """Outputs and truth of a structure under coloured forces."""
    generator = np.random.default_rng([99, number])
    truth = structure(generator, 4, (1.0, 13.0), (0.005, 0.15), 0, 4)
    rate, run_in, places = 4 * RATE, 8000, (1, 4)[number % 2]
    kind = ("resonance", "lowpass")[number % 4 // 2]
    frequency, damping = np.exp(generator.uniform(np.log([1.0, 0.03]), np.log([13.0, 0.6])))
    force = generator.standard_normal((run_in + 10_000, places))
    force = coloured(force, kind, rate, frequency, damping)
    y = np.zeros((len(force), 4))
    for f, z, shape in zip(*list(truth.values())[:2], truth["shapes"].T, strict=True):
        y += np.outer(modal(force @ shape[:places], f, z, rate, False), shape)
    y = y[run_in::4]
    return y + 0.05 * y.std(axis=0) * generator.standard_normal(y.shape), truth


def measured(part, number):  # type: ignore[no-untyped-def]
    """Counts of one record: with all rules, and as if one of them were not there."""
    from evopem.automatic import fit
    from evopem.estimation.state_space.estimate import estimates_of_orders
    from evopem.signals.recording import Segment, recording_of
    from evopem.validation.mode_evidence import doubts, mode_table

    y, truth = (mast if part == "masts" else colour)(number)
    kept = 4 * len(y) // 5
    recording, begun = recording_of(None, y, RATE), time.process_time()
    alone = [Segment(y[:kept, :0], y[:kept])]
    orders = fit.from_likeliest(alone, tuple(range(2, 81, 2)), fit.CommonSettings())
    estimates = estimates_of_orders(
        recording.between(0, kept),
        orders,
        delays=(),
        forgets=True,
        width=fit.LARGE_WIDTH,
        steps=fit.LARGE_STEPS,
    )
    table = mode_table(list(fit.until_bic_rises(estimates, False)), recording, kept)

    def counts(modes):  # type: ignore[no-untyped-def]
        found = {
            "frequencies_hz": [each.mode.frequency_hz for each in modes],
            "shapes": [[[z.real, z.imag] for z in each.mode.shape] for each in modes],
            "by_frequency": [not each.shape_trusted for each in modes],
        }
        pairs = paired(found, truth)
        hits = int((pairs >= 0).sum())
        return [len(truth["frequencies_hz"]), hits, len(modes) - hits]

    told = [
        each
        for each in table.modes
        if not doubts(
            replace(each, mode=replace(each.mode, equal_poles_p=0.0, shape_assurance=1.0)), RATE
        )
    ]
    return {
        "states": table.order,
        "seconds": time.process_time() - begun,
        "trusted": counts([each for each in table.modes if each.trusted]),
        "damping alone": counts(told),
    }


def write_evidence(folder):  # type: ignore[no-untyped-def]
    """The section of the page."""
    rows = []
    for part, name in (("masts", "masts"), ("colours", "coloured forces")):
        results = [json.loads(each.read_text()) for each in sorted(folder.glob(f"{part}_*.json"))]
        if not results:
            continue
        states = [each["states"] for each in results]
        seconds = np.median([each["seconds"] for each in results])
        for rule, shown in (("trusted", "both rules"), ("damping alone", "damping above 20 %")):
            true, hits, false = np.sum([each[rule] for each in results], axis=0)
            counted = f"{hits} of {true}", str(false), f"{min(states)} to {max(states)}"
            rows.append((name, str(len(results)), shown, *counted, f"{seconds:.0f} s"))
    write_section(
        "output_only",
        "Unmeasured forces of some colour",
        "Masts of 8 to 11 modes of 0.2 to 1 % damping at six sensors, and structures of four"
        " modes of 0.5 to 15 % under coloured\nforces at one or all of four sensors. Orders as in"
        " the automatic recipe, from two estimates each, without its final search;\na mode whose"
        " shape is doubted counts by its frequency. A pole is taken for the colour of the force"
        " above 20 % of damping, and\nabove 3 % where its shape is doubted; the first rule alone"
        " stands beside both. CPU time is the median of the records.",
        "benchmarks/unmeasured_forces.py",
        (
            "structures",
            "records",
            "colour of the force",
            "found and trusted",
            "false",
            "states",
            "CPU time",
        ),
        rows,
    )


def main() -> None:
    part, folder = sys.argv[1], Path(sys.argv[2])
    folder.mkdir(parents=True, exist_ok=True)
    if part == "evidence":
        write_evidence(folder)
    for number in map(int, sys.argv[3:]):
        found = measured(part, number)
        (folder / f"{part}_{number:02d}.json").write_text(json.dumps(found))
        print(part, number, found, flush=True)


if __name__ == "__main__":
    main()
