"""What is chosen from one recording of one blow?  docs/evidence/state_space.md has the table.

    python benchmarks/single_blow.py [--records 2]

A structure with three modes, two accelerometers and a hammer, 700 samples, noise of 2 % of the
largest output; the blow early and late in the record.  Two outputs: output-error and innovations
form.  One output: the automatic recipe.  Frequencies are compared with the truth.
"""

from __future__ import annotations

import argparse

import numpy as np
from threadpoolctl import threadpool_limits

from evopem.automatic.identify import identify
from evopem.automatic.state_space_choice import choose
from evopem.automatic.state_space_search import Variant, search_variant
from evopem.config.state_space_settings import StateSpaceChoices
from evopem.estimation.state_space.settings import StateSpaceSettings
from evopem.models.state_space_modes import ShapedMode
from evopem.signals.multichannel import MultichannelRecording

SAMPLES, NOISE, PLACES = 700, 0.02, (80, 450)
FREQUENCIES, DAMPING = np.array([0.03, 0.07, 0.12]), np.array([0.06, 0.03, 0.03])
VARIANTS = (Variant("output_error", "noise"), Variant("innovations", "determinant"))


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


def frequency_errors(modes: list[ShapedMode], truth: np.ndarray) -> str:
    """Number of modes, and the largest distance of a true frequency from the nearest, percent."""
    found = np.array([mode.frequency_hz for mode in modes])
    distances = [np.abs(found / each - 1.0).min() for each in truth] if found.size else [np.inf]
    return f"{found.size} | {100.0 * max(distances):.2f} %"


def two_outputs(seed: int, place: int) -> str:
    """The row of a record with two outputs."""
    force, outputs, truth = blow(seed, place)
    recording = MultichannelRecording(
        *(force - force.mean(), outputs - outputs.mean(axis=0), 1.0),
        *(("force",), ("a", "b"), ("",), ("", "")),
    )
    found = [
        search_variant(
            recording, each, (1,), range(2, 11, 2), StateSpaceSettings(weighting=each.weighting)
        )
        for each in VARIANTS
    ]
    choice = choose([search for search, _ in found], StateSpaceChoices()).model
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


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--records", type=int, default=2)
    arguments = parser.parse_args()
    print("| outputs | blow at | chosen | held-out errors, % | modes | largest error |")
    print("|---|---|---|---|---|---|")
    with threadpool_limits(limits=1, user_api="blas"):
        for row in (two_outputs, one_output):
            for place in PLACES:
                for seed in range(arguments.records):
                    print(row(seed, place), flush=True)


if __name__ == "__main__":
    main()
