"""How fast several channels are: three keys beside N4SID and one local descent, in one run.

    python benchmarks/speed_of_channels.py        (part of make bench)

Writes "Several channels" of docs/evidence/speed.md.  The recordings are simulated, with the sizes
of recordings of a flexible structure, of the arm of a CD player, and of a structure with 28
sensors.  evopem gets input, output and rate; N4SID, which is SIPPY's, or without an input the
canonical variates that evopem begins with, and the descent get the true order as well.
"""

from __future__ import annotations

import sys
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import NamedTuple, TypeVar

import numpy as np
from evidence import write_section
from threadpoolctl import threadpool_limits

ROOT = Path(__file__).resolve().parent.parent
sys.path[:0] = [str(ROOT / "workflow" / "scripts"), str(ROOT / "tests")]

from state_space import recorded, truth  # noqa: E402
from vibrating_structure import VibratingStructure  # noqa: E402

import evopem  # noqa: E402
from evopem.estimation.state_space.local_estimates import StateSpaceTask, descend_from  # noqa: E402
from evopem.estimation.state_space.point_model import PointModel  # noqa: E402
from evopem.estimation.state_space.starting_models import StartingModels  # noqa: E402
from evopem.models.state_space import StateSpaceModel  # noqa: E402
from evopem.signals.recording import Recording  # noqa: E402

RATE, LAGS = 100.0, 25
Result = TypeVar("Result")


class Record(NamedTuple):
    """A recording, and the number of states of what made it."""

    name: str
    inputs: np.ndarray
    outputs: np.ndarray
    order: int


def records() -> Iterator[Record]:
    """Simulated ones, noise of 10 %; the samples for validation are a fifth of them."""
    structure, arm = truth(2, 1, 8, "ss_oe", 1), truth(2, 2, 6, "ss", 2)
    yield Record("1500 samples, 2 × 2", *recorded(arm, 1500, 0.1, 1), 12)
    yield Record("6000 samples, 2 × 1", *recorded(structure, 6000, 0.1, 1, 0.8), 16)
    generator = np.random.default_rng(28)
    frequencies = 2.0 + 4.0 * (np.arange(10) + 0.5 + 0.3 * generator.uniform(-1.0, 1.0, 10))
    damping, shapes = 0.005 + 0.015 * generator.random(10), generator.standard_normal((28, 10))
    shaken = VibratingStructure(frequencies, damping, shapes)
    y = shaken.ambient_record(2000, RATE, 0.1, generator)
    yield Record("2000 samples, 28 outputs alone", np.empty((len(y), 0)), y, 20)


def seconds(action: Callable[[], Result]) -> tuple[Result, float]:
    """A result, and the processor time that it took."""
    began = time.process_time()
    return action(), time.process_time() - began


def by_subspace(record: Record) -> StateSpaceModel:
    """The estimate of the true order by linear algebra."""
    if record.inputs.shape[1] == 0:
        recording = Recording(record.inputs, record.outputs, RATE)
        errors = StateSpaceTask().errors(recording, record.order)
        point = next(StartingModels(errors, record.order, thorough=False).points(errors))
        return PointModel(errors, errors.projection(point)).model()
    from sippy_unipi import system_identification

    centred = record.outputs - record.outputs.mean(axis=0)
    options = {"SS_fixed_order": record.order, "SS_f": LAGS, "SS_p": LAGS}
    found = system_identification(centred.T, record.inputs.T, "N4SID", **options)
    return StateSpaceModel(
        **{name: np.asarray(getattr(found, name), dtype=float) for name in "ABCDK"},
        sampling_rate=RATE,
        level=record.outputs.mean(axis=0),
        noise_covariance=np.eye(record.outputs.shape[1]),
    )


def row(record: Record) -> list[str]:
    """Processor times, and how much of the subspace estimate's and the descent's ours is."""
    driven = record.inputs.shape[1] > 0
    given = (record.inputs if driven else None), record.outputs, RATE
    subspace, linear = seconds(lambda: by_subspace(record))
    recording = Recording(record.inputs, record.outputs, RATE)
    local, spent = seconds(lambda: descend_from(subspace, recording, StateSpaceTask()))
    found, own = seconds(lambda: evopem.identify(*given, show_progress=False))
    states = found.results.model.text
    cells = [
        *(record.name, f"{own:.0f} s; {states}", f"{linear:.2f} s", f"{spent:.1f} s"),
        *(f"{own / (linear + spent):.1f}", f"{local.model.order}"),
    ]
    print(" | ".join(cells), flush=True)
    return cells


def write_several_channels() -> None:
    """Measure, and write the section."""
    with threadpool_limits(limits=1):
        warm = np.random.default_rng(1).standard_normal((150, 4))
        evopem.identify(warm[:, :2], warm[:, 2:], RATE, show_progress=False)  # compiles
        by_subspace(next(records()))  # SIPPY's imports
        rows = [row(record) for record in records()]
    write_section(
        "speed",
        "Several channels",
        "Three keys, the whole automatic recipe with validation, against one estimate of the true "
        "order: N4SID of SIPPY 1.0\n(without an input evopem's canonical variates), and one local "
        "descent of the prediction errors from it. Simulated recordings,\nprocessor time.",
        "benchmarks/speed_of_channels.py",
        ("recording", "evopem", "N4SID", "descent from it", "ratio to both", "true order"),
        rows,
    )


if __name__ == "__main__":
    write_several_channels()
