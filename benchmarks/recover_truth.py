"""How often the whole order search recovers a known truth; writes docs/evidence/truth.md.

    python benchmarks/recover_truth.py [--arms 20] [--records 50] [--processes 2]

The chapter's case: the flexible arm, default configuration, seeds 1 to 20: is the delay found,
and how far are the modes from the truth?  A known ARMAX(7,6,7,3): 4500 estimation samples, seeds
1 to 50: are the exact orders found, or orders of smaller BIC?  Each record goes through delay and
all three phases with the built-in configuration.
"""

from __future__ import annotations

import argparse
import sys
from concurrent.futures import ProcessPoolExecutor
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

ROOT = Path(__file__).resolve().parent.parent
sys.path.insert(0, str(ROOT / "workflow" / "scripts"))

from evopem.config.defaults import complete  # noqa: E402
from evopem.config.order_grid import PHASES, candidate_orders, scoring_start  # noqa: E402
from evopem.estimation.order_selection import (  # noqa: E402
    continue_from,
    estimate_candidates,
    recall,
    search_again,
    select,
)
from evopem.signals.preparation import prepare  # noqa: E402
from evopem.signals.recording import Recording  # noqa: E402
from evopem.synthesis import synthesize  # noqa: E402

SCHEMA = ROOT / "workflow" / "schemas" / "config.schema.yaml"


def builtin_dataset(kind: str, objective: str) -> dict[str, Any]:
    config = {"datasets": {"x": {"synthesis": kind, "search": {"objective": objective}}}}
    dataset: dict[str, Any] = complete(config, SCHEMA)["datasets"]["x"]
    return dataset


def three_phases(data: Recording, dataset: dict[str, Any]) -> tuple[dict[str, int], dict[str, Any]]:
    start = scoring_start(dataset)
    selected: dict[str, int] | None = None
    candidates: list[dict[str, Any]] = []
    for phase in PHASES:
        orders = candidate_orders(phase, dataset, selected)
        settings = {"data": data, "search": dataset["search"], "scoring_start": start}
        candidates = estimate_candidates(orders=orders, phase=phase, **settings)
        selected, _, candidates = select(
            candidates,
            phase,
            partial(search_again, **settings),
            partial(continue_from, **settings),
        )
    assert selected is not None
    chosen = next(c for c in candidates if all(c[key] == selected[key] for key in selected))
    return selected, chosen


def recover_arm(seed: int, objective: str) -> dict[str, Any]:
    dataset = builtin_dataset("flexible_arm", objective)
    recording, truth = synthesize("flexible_arm", seed=seed, samples=5000)
    data = prepare(recording, dataset["stationarity"], dataset["split"]).estimation
    selected, chosen = three_phases(data, dataset)
    estimate = recall(chosen, data, dataset["search"], scoring_start(dataset))
    modes = []
    for true in truth["modes"]:
        near = min(
            estimate.model.modes(),
            key=lambda mode: abs(np.log(mode.frequency_hz / true["frequency_hz"])),
        )
        found = abs(near.frequency_hz / true["frequency_hz"] - 1.0) < 0.05
        modes.append(
            {
                "truth": true,
                "found": found and near.damping_ratio < 0.5,
                "frequency_hz": near.frequency_hz,
                "damping_percent": 100.0 * near.damping_ratio,
            }
        )
    return {
        "seed": seed,
        "selected": selected,
        "delay": truth["delay_samples"],
        "modes": modes,
        "evaluations": chosen["evaluations"],
    }


def recover_armax(seed: int, objective: str) -> dict[str, Any]:
    dataset = builtin_dataset("armax", objective)
    recording, truth = synthesize("armax", seed=seed, samples=4500)
    selected, chosen = three_phases(recording, dataset)
    true = tuple(truth["orders"].values())
    (at_truth,) = estimate_candidates(
        recording, [true], "truth", dataset["search"], scoring_start(dataset)
    )
    return {
        "seed": seed,
        "selected": selected,
        "exact": selected == truth["orders"],
        "bic": chosen["bic"],
        "bic_of_truth": at_truth["bic"],
    }


def arm_table(results: list[dict[str, Any]], objective: str) -> list[str]:
    delays = sum(r["selected"]["nk"] == r["delay"] for r in results)
    lines = [
        f"### Flexible arm, {objective} objective",
        "",
        f"{len(results)} records (seeds {results[0]['seed']} to {results[-1]['seed']}); the delay "
        f"of {results[0]['delay']} samples was chosen in {delays}.",
        "",
        "| true mode | found in | frequency error, median (largest) | damping error, median "
        "(largest) |",
        "|---|---|---|---|",
    ]
    for index, mode in enumerate(results[0]["modes"]):
        f, d = mode["truth"]["frequency_hz"], mode["truth"]["damping_percent"]
        found = [r["modes"][index] for r in results if r["modes"][index]["found"]]
        row = f"| {f:g} Hz, {d:.2f} % | {len(found)} of {len(results)} | "
        if found:
            ef = [100.0 * abs(m["frequency_hz"] / f - 1.0) for m in found]
            ed = [100.0 * abs(m["damping_percent"] / d - 1.0) for m in found]
            row += (
                f"{np.median(ef):.2f} % ({max(ef):.2f} %) | {np.median(ed):.1f} % ({max(ed):.1f} %)"
            )
        else:
            row += "– | –"
        lines.append(row + " |")
    orders = sorted({tuple(r["selected"].values()) for r in results})
    lines += ["", "Orders chosen: " + ", ".join(f"({','.join(map(str, o))})" for o in orders) + "."]
    return [*lines, ""]


def armax_table(results: list[dict[str, Any]], objective: str) -> list[str]:
    exact = sum(r["exact"] for r in results)
    smaller = [r for r in results if not r["exact"] and r["bic"] < r["bic_of_truth"]]
    neither = [r for r in results if not r["exact"] and r["bic"] >= r["bic_of_truth"]]
    lines = [
        f"### ARMAX(7,6,7,3), {objective} objective",
        "",
        f"{len(results)} records of 4500 samples: the exact orders in {exact}, other orders of "
        f"smaller BIC in {len(smaller)}, neither in {len(neither)}.",
        "",
    ]
    for r in smaller + neither:
        orders = ",".join(str(value) for value in r["selected"].values())
        lines.append(
            f"- seed {r['seed']}: ARMAX({orders}), BIC {r['bic']:.5f} against "
            f"{r['bic_of_truth']:.5f} of the true orders"
        )
    return [*lines, ""]


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--arms", type=int, default=20)
    parser.add_argument("--records", type=int, default=50)
    parser.add_argument("--processes", type=int, default=2)
    parser.add_argument("--arm-objectives", nargs="+", default=["absolute"])
    parser.add_argument("--record-objectives", nargs="+", default=["quadratic"])
    arguments = parser.parse_args()
    lines = [
        "# Recovery of known truths",
        "",
        "Written by `python benchmarks/recover_truth.py`; every record goes through the delay",
        "search and the three phases with the built-in configuration.",
        "",
    ]
    target = ROOT / "docs" / "evidence" / "truth.md"
    target.parent.mkdir(parents=True, exist_ok=True)
    stages = (
        (recover_arm, arm_table, arguments.arms, arguments.arm_objectives),
        (recover_armax, armax_table, arguments.records, arguments.record_objectives),
    )
    with ProcessPoolExecutor(arguments.processes) as pool:
        for recover, table, count, objectives in stages:
            for objective in objectives if count else []:
                run = partial(recover, objective=objective)
                results = []
                for result in pool.map(run, range(1, count + 1)):
                    results.append(result)
                    print(objective, result, flush=True)
                lines += table(results, objective)
                target.write_text("\n".join(lines).rstrip() + "\n", encoding="utf-8")


if __name__ == "__main__":
    main()
