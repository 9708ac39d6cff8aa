"""What is chosen from one recording of one blow?  docs/evidence/state_space.md has the table.

    python benchmarks/single_blow.py [--records 2]
    python benchmarks/single_blow.py --part rest [--records 1] [--outputs 1 2]

A structure with three modes, two accelerometers and a hammer, 700 samples, noise of 2 % of the
largest output; the blow early and late in the record.  Two outputs: output-error and innovations
form.  One output: the automatic recipe.  Frequencies are compared with the truth.

``--part rest``: ordinary tests with a rest of 20 to 40 % of the record before, in the middle or
behind.  The choice by parts of equal energy of the response, as a blow has them, against that by
parts of equal length, by the simulation of the noise-free output of a fresh record.
"""

from __future__ import annotations

import argparse
import itertools
from collections.abc import Callable, Iterator
from typing import NamedTuple
from unittest.mock import patch

import numpy as np
from evopem.automatic.searched_forms import search_variant
from evopem.automatic.state_space_choice import choose
from evopem.automatic.variant_search import Variant
from state_space_choice import Plant, held, light_plant, recording_of, slow_plant
from threadpoolctl import threadpool_limits

from evopem.automatic import folds, multichannel_folds
from evopem.automatic.identify import identify
from evopem.automatic.response_parts import response_parts
from evopem.config.settings import AutomaticSettings
from evopem.estimation.state_space.task import QUADRATIC
from evopem.models.modes import Mode
from evopem.signals.recording import Recording
from evopem.validation.multichannel import mean_errors

SAMPLES, NOISE, PLACES = 700, 0.02, (80, 450)
FREQUENCIES, DAMPING = np.array([0.03, 0.07, 0.12]), np.array([0.06, 0.03, 0.03])
VARIANTS = (Variant("ss_oe", "noise"), Variant("ss", "determinant"))


def blow(seed: int, place: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Force (N, 1), accelerations (N, 2), and undamped frequencies in cycles per sample."""
    generator = np.random.default_rng(np.random.SeedSequence(41, spawn_key=(seed,)))
    frequencies = FREQUENCIES * (1.0 + 0.1 * generator.random(3))
    shapes = generator.uniform(0.5, 1.0, (3, 2)) * generator.choice([-1.0, 1.0], (3, 2))
    poles = np.exp(2.0 * np.pi * frequencies * (-DAMPING + 1j * np.sqrt(1.0 - DAMPING**2)))
    force = np.zeros((SAMPLES, 1))
    force[place : place + 3, 0] = [0.5, 1.0, 0.5]
    state, outputs = np.zeros(3, dtype=complex), np.zeros((SAMPLES, 2))
    for sample in range(SAMPLES):
        outputs[sample] = state.imag @ shapes
        state = poles * state + force[sample]
    outputs += NOISE * np.abs(outputs).max() * generator.standard_normal(outputs.shape)
    return force, outputs, frequencies


def frequency_errors(modes: list[Mode], truth: np.ndarray) -> str:
    """Number of modes, and the largest distance of a true frequency from the nearest, percent."""
    found = np.array([mode.frequency_hz for mode in modes])
    distances = [np.abs(found / each - 1.0).min() for each in truth] if found.size else [np.inf]
    return f"{found.size} | {100.0 * max(distances):.2f} %"


def two_outputs(seed: int, place: int) -> str:
    """The row of a record with two outputs."""
    force, outputs, truth = blow(seed, place)
    recording = Recording(
        *(force - force.mean(), outputs - outputs.mean(axis=0), 1.0),
        *(("force",), ("a", "b"), ("",), ("", "")),
    )
    found = [search_variant(recording, each, (1,), range(2, 11, 2), QUADRATIC) for each in VARIANTS]
    choice = choose([search for search, _ in found], AutomaticSettings()).model
    search, models = found[VARIANTS.index(choice.variant)]
    errors = ", ".join(f"{error:.0f}" for error in search.simulation)
    modes = models.of_order(choice.order).modes()
    name = f"{choice.variant.form} {choice.order}"
    return f"| 2 | {place} | {name} | {errors} | {frequency_errors(modes, truth)} |"


def one_output(seed: int, place: int) -> str:
    """The row of a record with one output."""
    force, outputs, truth = blow(seed, place)
    found = identify(force[:, 0], outputs[:, 0], 1.0)
    candidate = found.choice.candidate
    errors = f"{candidate.scores.simulation:.0f}"
    modes = frequency_errors(found.model.modes(), truth)
    return f"| 1 | {place} | {candidate.name} | {errors} | {modes} |"


# Samples of an ordinary test with its rest, of the fresh record, and the shares of noise and rest.
TEST, FRESH = 600, 1000
NOISES, RESTS = (0.05, 0.2), (0.2, 0.4)
SYSTEMS = ("slow", "light", "both")
INPUTS = ("white", "multisine", "steps")
WHERE = ("before", "middle", "behind")


class Rested(NamedTuple):
    """A record with a rest, and a fresh one without: inputs, measured and noise-free outputs."""

    u: np.ndarray
    y: np.ndarray
    fresh_u: np.ndarray
    fresh_clean: np.ndarray


def plant_of(system: str, generator: np.random.Generator, channels: int) -> Plant:
    """Slow real poles, lightly damped modes, or one mode and real poles."""
    if system == "slow":
        return slow_plant(generator, channels, channels, 4)
    if system == "light":
        return light_plant(generator, channels, channels, 6)
    slow, light = (
        slow_plant(generator, channels, channels, 3),
        light_plant(generator, channels, channels, 2),
    )
    A = np.zeros((5, 5))
    A[:3, :3], A[3:, 3:] = slow.A, light.A
    return Plant(A, np.vstack([slow.B, 0.1 * light.B]), np.hstack([slow.C, light.C]))


def excitation(
    kind: str, generator: np.random.Generator, samples: int, channels: int
) -> np.ndarray:
    """Inputs of a test, (samples, channels)."""
    if kind == "white":
        return generator.standard_normal((samples, channels))
    if kind == "steps":
        return held(generator, samples, channels, 30)
    phases = generator.uniform(0.0, 2.0 * np.pi, (channels, samples // 4))
    angles = 2.0 * np.pi * np.outer(np.arange(samples), np.arange(1, samples // 4 + 1)) / samples
    return np.column_stack([np.cos(angles + each).sum(axis=1) for each in phases]) / np.sqrt(
        samples / 8
    )


def rested(system: str, kind: str, where: str, seed: int, channels: int) -> Rested:
    """A test with a rest of random length, and noise of a random share."""
    key = (SYSTEMS.index(system), INPUTS.index(kind), WHERE.index(where), channels, seed)
    g = np.random.default_rng(np.random.SeedSequence(59, spawn_key=key))
    plant = plant_of(system, g, channels)
    noise, share = g.uniform(*NOISES), g.uniform(*RESTS)
    quiet = round(share * TEST)
    first = {"before": 0, "middle": (TEST - quiet) // 2, "behind": TEST - quiet}[where]
    u = np.insert(excitation(kind, g, TEST - quiet, channels), [first] * quiet, 0.0, axis=0)
    clean = plant.respond(u)
    y = clean + noise * clean.std(axis=0) * g.standard_normal(clean.shape)
    fresh_u = excitation(kind, g, FRESH, channels)
    return Rested(u, y, fresh_u, plant.respond(fresh_u))


def chosen_of_several(record: Rested) -> tuple[str, float]:
    """The form and order chosen, and its error in percent on the fresh record."""
    middle_u, middle_y = record.u.mean(axis=0), record.y.mean(axis=0)
    recording = recording_of(record.u - middle_u, record.y - middle_y)
    fresh = recording_of(record.fresh_u - middle_u, record.fresh_clean - middle_y)
    found = [
        search_variant(
            *(recording, each, (1,) * record.u.shape[1], range(1, 9)),
            QUADRATIC,
        )
        for each in VARIANTS
    ]
    choice = choose([search for search, _ in found], AutomaticSettings()).model
    model = found[VARIANTS.index(choice.variant)][1].of_order(choice.order)
    error = mean_errors(model, fresh, choice.level == "state")[1]
    return f"{choice.variant.form} {choice.order}", error


def chosen_of_one(record: Rested) -> tuple[str, float]:
    """The same of the automatic recipe."""
    found = identify(record.u[:, 0], record.y[:, 0], 1.0)
    errors = found.validate(Recording(record.fresh_u[:, 0], record.fresh_clean[:, 0], 1.0))
    return found.choice.candidate.name, errors.simulation


def with_rests(channels: int, records: int) -> Iterator[tuple[tuple[str, str, str], float]]:
    """The kind of each record that energy divides, and the ratio of the errors of both choices."""
    chosen: Callable[[Rested], tuple[str, float]]
    chosen = chosen_of_one if channels == 1 else chosen_of_several
    for kind in itertools.product(SYSTEMS, INPUTS, WHERE):
        for seed in range(records):
            record = rested(*kind, seed, channels)
            parts = response_parts(record.u, record.y, 5, folds.SHORTEST_BLOCK)
            if parts is None:
                print(f"| {channels} | {', '.join(kind)} | not divided by energy | | |")
                continue
            by_energy = chosen(record)
            with (
                patch.object(folds, "response_parts", return_value=None),
                patch.object(multichannel_folds, "response_parts", return_value=None),
            ):
                by_length = chosen(record)
            cells = [f"{name}: {error:.2f} %" for name, error in (by_length, by_energy)]
            ratio = by_energy[1] / by_length[1]
            print(
                f"| {channels} | {', '.join(kind)} | {' | '.join(cells)} | {ratio:.3f} |",
                flush=True,
            )
            yield kind, ratio


def print_rests(outputs: list[int], records: int) -> None:
    """A row for each record, and geometric means of each kind."""
    print("| outputs | system, input, rest | equal lengths | equal energy | ratio |")
    print("|---|---|---|---|---|")
    for channels in outputs:
        ratios: dict[str, list[float]] = {}
        for kind, ratio in with_rests(channels, records):
            for name in ("all", *kind):
                ratios.setdefault(name, []).append(ratio)
        for name, each in ratios.items():
            other = sum(abs(ratio - 1.0) > 1e-6 for ratio in each)
            mean = np.exp(np.mean(np.log(each)))
            print(
                f"{channels} outputs, {name}: {len(each)} records, {other} with another choice,"
                f" geometric mean {mean:.3f}, from {min(each):.3f} to {max(each):.3f}"
            )


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--part", choices=("blow", "rest"), default="blow")
    parser.add_argument("--records", type=int, default=2)
    parser.add_argument("--outputs", type=int, nargs="*", default=[2, 1], help="with a rest")
    arguments = parser.parse_args()
    with threadpool_limits(limits=1, user_api="blas"):
        if arguments.part == "rest":
            print_rests(arguments.outputs, arguments.records)
        else:
            print_blows(arguments.records)


def print_blows(records: int) -> None:
    print("| outputs | blow at | chosen | held-out errors, % | modes | largest error |")
    print("|---|---|---|---|---|---|")
    for row in (two_outputs, one_output):
        for place in PLACES:
            for seed in range(records):
                print(row(seed, place), flush=True)


if __name__ == "__main__":
    main()
