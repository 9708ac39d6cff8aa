"""Estimates of fifteen recordings, to compare optima and choices of two versions of evopem.

``write FILE`` estimates models of all structures, and identifies some recordings automatically;
``compare FILE OTHER`` prints where the second is different, and the largest relative excess of an
objective among models of equal states: ``ss_bj`` chooses those of its noise model.  Polynomials are
the lowest of several seeds, because searches that end at their budget may miss what others reach.
Real recordings are those of a folder, ``--data``; without it they are left out.
"""

from __future__ import annotations

import argparse
import json
import sys
import time
from itertools import product
from pathlib import Path

import numpy as np
from scipy.signal import lfilter

sys.path.insert(0, str(Path(__file__).parents[1] / "workflow" / "scripts"))

import evopem
from evopem.synthesis import armax, flexible_arm

POLYNOMIALS = {
    "fir": {"nb": 12},
    "arx": {"na": 3, "nb": 3},
    "armax": {"na": 3, "nb": 3, "nc": 2},
    "ararx": {"na": 2, "nb": 2, "nd": 2},
    "ararmax": {"na": 2, "nb": 2, "nc": 1, "nd": 1},
    "oe": {"nb": 3, "nf": 3},
    "bj": {"nb": 2, "nc": 1, "nd": 2, "nf": 3},
}
STATE_SPACE = ("ss", "ss_oe", "ss_bj")
OUTPUT_ONLY = {"arma": {"na": 4, "nc": 3}}
SEEDS = (1, 2, 3)


def filtered(seed: int, inputs: int, outputs: int, samples: int, noise: float, segments: int = 1):
    """Recordings of one system with three poles in each path and coloured noise, with levels."""
    generator = np.random.default_rng(seed)
    f = np.poly([0.9 * np.exp(0.6j), 0.9 * np.exp(-0.6j), 0.5]).real
    gains = generator.standard_normal((outputs, inputs, 2))
    parts = []
    for number in range(segments):
        u = generator.standard_normal((samples, inputs))
        y = np.zeros((samples, outputs))
        for i, k in product(range(outputs), range(inputs)):
            y[:, i] += lfilter(np.r_[0.0, gains[i, k]], f, u[:, k])
        e = lfilter([1.0], [1.0, -0.8], generator.standard_normal(y.shape), axis=0)
        y += noise * y.std(axis=0) * e + 0.5 * number
        parts.append((u, y))
    return evopem.Recording(
        *(np.concatenate(each) for each in zip(*parts, strict=True)),
        10.0,
        segment_starts=tuple(samples * number for number in range(segments)),
        segment_recordings=tuple(range(segments)),
    )


def recordings(data: Path | None) -> dict[str, evopem.Recording]:
    """The recordings by name."""
    found = {
        "armax": armax(seed=1, samples=1000)[0],
        "armax, noisy": armax(seed=2, samples=600, noise=0.5)[0],
        "arm": flexible_arm(seed=1, samples=1500)[0],
        "filtered": filtered(1, 1, 1, 500, 0.1),
        "filtered, noisy": filtered(2, 1, 1, 800, 1.0),
        "two recordings": filtered(3, 1, 1, 300, 0.2, segments=2),
        "two inputs": filtered(4, 2, 1, 500, 0.1),
        "three inputs, two recordings": filtered(5, 3, 1, 300, 0.2, segments=2),
        "two by two": filtered(6, 2, 2, 400, 0.1),
        "one by three": filtered(7, 1, 3, 400, 0.1),
        "output only": evopem.Recording(
            np.empty((800, 0)), filtered(8, 1, 1, 800, 1.0).outputs, 10.0
        ),
    }
    if data is not None:
        arm = np.loadtxt(data / "daisy" / "robot_arm.dat")
        dryer = np.loadtxt(data / "daisy" / "dryer.dat")
        cd = np.loadtxt(data / "daisy" / "CD_player_arm.dat")
        found["robot arm"] = evopem.Recording(arm[:800, 0], arm[:800, 1], 125.0)
        found["dryer"] = evopem.Recording(dryer[:750, 0], dryer[:750, 1], 12.5)
        found["CD arm, one output"] = evopem.Recording(cd[:800, :2], cd[:800, 2], 1.0)
        found["CD arm"] = evopem.Recording(cd[:800, :2], cd[:800, 2:], 1.0)
    return found


def estimates(recording: evopem.Recording) -> dict[str, dict[str, object]]:
    """The objective and modes of models of every structure, by structure and objective."""
    m, outputs = recording.inputs.shape[1], recording.outputs.shape[1]
    polynomials = OUTPUT_ONLY if m == 0 else POLYNOMIALS
    cases = [(name, orders) for name, orders in polynomials.items() if outputs == 1]
    cases += [(name, {"n": 4}) for name in (STATE_SPACE if m else ("ss",))]
    rows: dict[str, dict[str, object]] = {}
    for (name, orders), objective in product(cases, ("quadratic", "absolute")):
        if objective == "absolute" and name not in ("arx", "armax", "oe", "ss_oe"):
            continue
        known = dict(orders) | ({"nk": 1} if m else {})
        given = {"orders": known, "structure": name, "level": True}
        searches = [
            evopem.SearchSettings(objective=objective, seed=seed, evaluations=5000)
            for seed in (SEEDS[:1] if name in STATE_SPACE else SEEDS)
        ]
        began = time.process_time()
        try:
            found = [evopem.estimate(recording, settings=each, **given) for each in searches]
        except ValueError as error:
            rows[f"{name}, {objective}"] = {"refused": str(error)}
            continue
        model = min(found, key=lambda each: each.objective)
        modes = sorted(mode.frequency_hz for mode in model.model.modes())
        states = {"states": len(model.model.A)} if name in STATE_SPACE else {}
        rows[f"{name}, {objective}"] = states | {
            "objective": float(model.objective),
            "residuals": _loss(model.residuals, objective),
            "modes_hz": [round(each, 6) for each in modes],
            "seconds": round(time.process_time() - began, 2),
        }
    return rows


def _loss(residuals, objective: str) -> float:
    """The sum of absolute or squared residuals that were computed, of all segments."""
    e = np.hstack([np.ravel(part) for part in residuals])
    return float(np.nansum(np.abs(e) if objective == "absolute" else e**2))


AUTOMATIC = (
    *("armax", "filtered", "filtered, noisy", "robot arm", "dryer", "two inputs", "one by three"),
)


def identified(recording: evopem.Recording) -> dict[str, object]:
    """What the automatic recipe chooses, and its errors on the last fifth of the samples."""
    began = time.process_time()
    columns = {"u": recording.inputs, "y": recording.outputs}
    chosen = evopem.identify(
        columns["u"], columns["y"], sampling_rate=recording.sampling_rate, show_progress=False
    )
    return {
        "model": repr(chosen).splitlines()[0],
        "simulation_error_percent": float(chosen.simulation_error_percent),
        "prediction_error_percent": float(chosen.prediction_error_percent),
        "failed": sorted(each.name for each in chosen.checks if each.passed is False),
        "seconds": round(time.process_time() - began, 1),
    }


def compare(first: dict, second: dict) -> None:
    """Print the differences of two files, and the largest relative excess of the second."""
    excess = []
    for name, cases in first["estimates"].items():
        for case, row in cases.items():
            new = second["estimates"].get(name, {}).get(case, {})
            if "objective" not in row or "objective" not in new:
                if row.keys() != new.keys():
                    print(f"{name}: {case}: {row} -> {new}")
                continue
            if row.get("states") != new.get("states"):
                print(f"{name}: {case}: {row.get('states')} -> {new.get('states')} states")
                continue
            relative = new["objective"] / row["objective"] - 1.0
            excess.append((relative, f"{name}: {case}"))
            if abs(relative) > 1e-6:
                print(f"{name}: {case}: {row['objective']:.9g} -> {new['objective']:.9g}")
    worst = max(excess)
    lower = sum(relative < -1e-6 for relative, _ in excess)
    print(f"{len(excess)} optima, largest excess {worst[0]:.2e} ({worst[1]}), {lower} lower")
    for name, row in first["automatic"].items():
        print(f"{name}:\n  {row}\n  {second['automatic'].get(name)}")


def main() -> None:
    """Write results, or compare two files of them."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("action", choices=["write", "compare"])
    parser.add_argument("files", nargs="+", type=Path)
    parser.add_argument("--data", type=Path, help="folder of the recordings for tests")
    given = parser.parse_args()
    if given.action == "compare":
        compare(*(json.loads(file.read_text()) for file in given.files))
        return
    known = recordings(given.data)
    results: dict[str, dict] = {"estimates": {}, "automatic": {}}
    for name, recording in known.items():
        results["estimates"][name] = estimates(recording)
        print(name, flush=True)
        given.files[0].write_text(json.dumps(results, indent=1))
    for name in AUTOMATIC:
        if name in known:
            results["automatic"][name] = identified(known[name])
            print(name, results["automatic"][name], flush=True)
            given.files[0].write_text(json.dumps(results, indent=1))


if __name__ == "__main__":
    main()
