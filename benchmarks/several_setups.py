"""Measure merged modes of several set-ups; docs/evidence/state_space.md has the results.

    python benchmarks/several_setups.py FOLDER [--structures 100]
    PYTHON_WITH_PYOMA2 benchmarks/several_setups.py FOLDER --peer
    python benchmarks/several_setups.py FOLDER --write

Simulated structures of four modes at ten sensors in four set-ups: two sensors stay and two others
move, or two sensors stay, a hammer moves, and one point is hit in every set-up.  Levels of
excitation differ by up to a factor of 20; the order is known.  ``--peer`` needs ``pip install
pyOMA-2==1.4.3`` and merges by pre-estimation re-scaling, without intervals; of its stable poles
that most like each true mode counts.  Finished structures are left out, so that it can be stopped.
"""

from __future__ import annotations

import argparse
import json
import sys
import time
from pathlib import Path

import numpy as np

ROOT = Path(__file__).resolve().parent.parent
sys.path[:0] = [str(ROOT / "workflow" / "scripts"), str(ROOT / "tests")]

RATE, SAMPLES, NOISE, ORDER = 100.0, 4000, 0.1, 8
FIXED, ROVING = [0, 1], [[2, 3], [4, 5], [6, 7], [8, 9]]
KINDS = ("roving sensors", "one contradicts", "roving hammer")
SOFTENED = 0.97


def records(kind: str, number: int):  # type: ignore[no-untyped-def]
    """The structure and, of each set-up, sensors, hit points, inputs and outputs."""
    from vibrating_structure import VibratingStructure, random_structure

    generator = np.random.default_rng(np.random.SeedSequence(33, spawn_key=(number,)))
    structure = random_structure(generator, 4, 10, close_pairs=0)
    setups = []
    for place, moved in enumerate(ROVING):
        seen, level = structure, np.exp(generator.uniform(-1.5, 1.5))
        if kind == "one contradicts" and place == 2:
            seen = structure.softened(SOFTENED)
        if kind == "roving hammer":
            points = [0, *moved]
            order = [*points, *(k for k in range(10) if k not in points)]
            turned = VibratingStructure(
                seen.frequencies_hz, seen.damping_ratios, seen.shapes[order]
            )
            u, y = turned.driven_record(SAMPLES, RATE, len(points), NOISE, generator)
            setups.append((FIXED, points, level * u, level * y[:, [order.index(k) for k in FIXED]]))
            continue
        sensors = [*FIXED, *moved]
        y = level * seen.ambient_record(SAMPLES, RATE, NOISE, generator)[:, sensors]
        setups.append((sensors, [], np.empty((len(y), 0)), y))
    return structure, setups


def merged(setups):  # type: ignore[no-untyped-def]
    from evopem.estimation.state_space.estimate import estimates_of_orders
    from evopem.models.merged_modes import merge_setups
    from evopem.models.setups import Setup
    from evopem.signals.recording import Recording

    given = []
    for place, (sensors, points, u, y) in enumerate(setups):
        recording = Recording(
            *(u, y, RATE),
            *(tuple(f"force{k}" for k in points), tuple(f"y{k}" for k in sensors)),
            *(("",) * len(points), ("",) * len(sensors)),
        )
        form = {"structure": "ss_oe", "delays": 0} if points else {}
        (estimate,) = estimates_of_orders(recording, [ORDER], width=1, **form)
        given.append(Setup.of(f"{place}", estimate.model))
    return merge_setups(given)


def own(kind: str, number: int) -> dict[str, object]:
    """Which intervals cover the truth, agreement of shapes, and the set-ups that are named."""
    from evopem.models.modes import assurance

    structure, setups = records(kind, number)
    begun = time.process_time()
    found = merged(setups)
    result: dict[str, object] = {
        "seconds": time.process_time() - begun,
        "named": [each.setup for each in found.contradictions],
        "modes": len(found.modes),
    }
    hits: dict[str, list[bool]] = {kind: [] for kind in ("frequency", "damping", "shape", "drive")}
    agreement, points = [], [int(name.removeprefix("force")) for name in found.inputs]
    for mode, errors in zip(found.modes, found.drive_errors, strict=True):
        apart = np.abs(np.log(structure.frequencies_hz / mode.frequency_hz))
        k = int(np.argmin(apart))
        phi = structure.shapes[[int(name[1:]) for name in found.outputs], k]
        f, z = structure.frequencies_hz[k], structure.damping_ratios[k]
        hits["frequency"].append(abs(mode.frequency_hz - f) < 1.96 * mode.frequency_se_hz)
        hits["damping"].append(abs(mode.damping_ratio - z) < 1.96 * mode.damping_se)
        one = int(np.argmax(np.abs(mode.shape)))
        scale = phi[one]
        off = np.delete(mode.shape - phi / scale, one)
        for part, error in ((off.real, mode.shape_se_real), (off.imag, mode.shape_se_imag)):
            hits["shape"] += list(np.abs(part) < 1.96 * np.delete(error, one))
        agreement.append(assurance(mode.shape, phi.astype(complex)))
        if points:
            true = structure.shapes[points, k]
            drives = 0.5 * (1.0 + 1j * z / np.sqrt(1.0 - z**2)) * scale * true
            off = mode.input_participation - drives
            hits["drive"] += list(np.abs(off.real) < 1.96 * errors.real)
            hits["drive"] += list(np.abs(off.imag) < 1.96 * errors.imag)
            agreement[-1] = assurance(mode.input_participation, true.astype(complex))
    shares = {kind: float(np.mean(each)) for kind, each in hits.items() if each}
    return result | {"covered": shares, "agreement": agreement}


def peer(kind: str, number: int) -> dict[str, object]:
    """Agreement of shapes that pyOMA2 merges: the most alike of its stable poles within 2 %."""
    from modes_to_trust import stable_poles
    from pyoma2.algorithms import SSI_MS
    from pyoma2.setup import MultiSetup_PreGER

    structure, setups = records(kind, number)
    begun = time.process_time()
    merge = MultiSetup_PreGER(RATE, [[0, 1]] * len(setups), [y for *_, y in setups])
    merge.add_algorithms(SSI_MS(name="ssi", method="cov", br=30, ordmax=40, step=2))
    merge.run_by_name("ssi")
    frequencies, _, shapes = stable_poles(merge["ssi"].result)
    order = [*FIXED, *(k for moved in ROVING for k in moved)]
    best: list[float] = []
    for f, true in zip(structure.frequencies_hz, structure.shapes[order].T, strict=True):
        near = np.abs(frequencies / f - 1.0) < 0.02
        sizes = np.linalg.norm(shapes, axis=1) * np.linalg.norm(true)
        best.append(float(np.max((np.abs(shapes @ true) / sizes)[near] ** 2, initial=0.0)))
    return {"seconds": time.process_time() - begun, "agreement": best}


def row(kind: str, method: str, results: list[dict]) -> list[str]:  # type: ignore[type-arg]
    """One row of the table."""
    # NaN: a set-up lacks the mode.
    alike = np.nan_to_num([value for each in results for value in each["agreement"]])
    cells = [kind, method, str(len(results)), f"{100 * np.mean(alike >= 0.99):.1f} %"]
    cells.append(f"{np.quantile(alike, 0.01):.4f}")
    for what in ("frequency", "damping", "shape", "drive"):
        shares = [each["covered"][what] for each in results if what in each.get("covered", {})]
        cells.append(f"{100 * np.mean(shares):.1f} %" if shares else "–")
    named = sum(bool(each.get("named")) for each in results)
    cells.append(str(named) if "named" in results[0] else "–")
    return cells


def write(folder: Path) -> None:
    from evidence import write_section

    rows = []
    for kind in KINDS:
        for method in ("evopem", "pyOMA2"):
            files = sorted(folder.glob(f"{kind}.{method}.*.json"))
            results = [json.loads(file.read_text()) for file in files]
            if results:
                rows.append(row(kind, method, results))
    write_section(
        "state_space",
        "Several set-ups",
        "Four modes at ten sensors in four set-ups of 4000 samples, two sensors in all of them,"
        " noise of 10 %, levels of excitation up to 20 times apart, order and form known; for the"
        " hammer, agreement is that of its points. *One contradicts*: the third has 3 % less"
        " stiffness;"
        " intervals are of the other structure. *Named*: structures with a set-up that is said to"
        " contradict the others. pyOMA2 1.4 merges before estimation; its most alike stable pole"
        " counts.",
        "benchmarks/several_setups.py",
        [
            *("set-ups", "method", "structures", "MAC ≥ 0.99", "MAC, 1 % quantile", "frequency"),
            *("damping", "shape", "drives", "named"),
        ],
        rows,
    )


def main() -> None:
    parser = argparse.ArgumentParser()
    parser.add_argument("folder", type=Path)
    parser.add_argument("--structures", type=int, default=100)
    parser.add_argument("--kind", choices=KINDS, nargs="*", default=KINDS)
    parser.add_argument("--peer", action="store_true")
    parser.add_argument("--write", action="store_true")
    arguments = parser.parse_args()
    if arguments.write:
        write(arguments.folder)
        return
    arguments.folder.mkdir(parents=True, exist_ok=True)
    for kind in KINDS[:1] if arguments.peer else arguments.kind:
        for number in range(arguments.structures):
            method = "pyOMA2" if arguments.peer else "evopem"
            file = arguments.folder / f"{kind}.{method}.{number:03d}.json"
            if not file.exists():
                made = (peer if arguments.peer else own)(kind, number)
                file.write_text(json.dumps(made))


if __name__ == "__main__":
    main()
