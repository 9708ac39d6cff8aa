"""Measure output-only identification; docs/evidence/output_only.md holds the tables it prints.

    python benchmarks/output_only.py records FOLDER [--records 100]
    PYTHON_WITH_PYOMA2 benchmarks/output_only.py peers FOLDER
    python benchmarks/output_only.py own FOLDER
    python benchmarks/output_only.py table FOLDER
    python benchmarks/output_only.py coverage [--records 200]

Each record is one of a random structure with six modes, two of which have a close neighbour, at
four sensors, with 5 to 30 % of white sensor noise.  All methods get the same samples; evopem keeps
the last quarter for its held-out tests.  A mode is found where its frequency is within 2 % of the
truth and its shape has a MAC of at least 0.8 with the true one; each estimate is paired with one
true mode at most.  What is left on either side is false or missed.
"""

from __future__ import annotations

import argparse
import json
import sys
import time
from pathlib import Path

import numpy as np

ROOT = Path(__file__).resolve().parent.parent
sys.path.insert(0, str(ROOT / "workflow" / "scripts"))

RATE, SAMPLES = 100.0, 4000
ORDERS = range(6, 17, 2)
SAME_FREQUENCY, SAME_SHAPE = 0.02, 0.8
# Names of pyOMA2's clusterings.
CLUSTERINGS = ("Magalhaes", "Reynders", "Neu", "Kvaale", "Dederichs", "hier_avg")
# Distances within which stable poles of pLSCF are linked.
REACHES = (0.02, 0.05)


def write_records(folder: Path, count: int) -> None:
    from evopem.synthesis.vibrating_structure import random_structure

    folder.mkdir(parents=True, exist_ok=True)
    for number in range(count):
        generator = np.random.default_rng(np.random.SeedSequence(20, spawn_key=(number,)))
        structure = random_structure(generator)
        noise = generator.uniform(0.05, 0.3)
        np.savez(
            folder / f"{number:03d}.npz",
            y=structure.ambient_record(SAMPLES, RATE, noise, generator),
            frequencies_hz=structure.frequencies_hz,
            damping_ratios=structure.damping_ratios,
            shapes=structure.shapes,
            noise=noise,
        )


def found_modes(frequencies, dampings, shapes, **more):  # type: ignore[no-untyped-def]
    """Modes of an estimate in the form of the files; shapes (ny, m)."""
    shapes = np.asarray(shapes, dtype=complex)
    return {
        "frequencies_hz": np.asarray(frequencies, dtype=float).tolist(),
        "damping_ratios": np.asarray(dampings, dtype=float).tolist(),
        "shapes": [[[z.real, z.imag] for z in column] for column in shapes.T],
    } | {name: np.asarray(values).tolist() for name, values in more.items()}


def run_peers(folder: Path) -> None:
    from pyoma2.algorithms import SSI, pLSCF
    from pyoma2.algorithms.data.run_params import Clustering
    from pyoma2.setup import SingleSetup

    for file in sorted(folder.glob("???.npz")):
        result_file = file.with_suffix(".peers.json")
        if result_file.exists():
            continue
        y = np.load(file)["y"]
        results = {}
        setup = SingleSetup(y, fs=RATE)
        begun = time.process_time()
        ssi = SSI(name="ssi", method="cov", br=30, ordmax=60, step=2)
        setup.add_algorithms(ssi)
        setup.run_by_name("ssi")
        seconds = time.process_time() - begun
        for name in CLUSTERINGS:
            begun = time.process_time()
            try:
                ssi.add_clustering(Clustering(name=name, quick=name))
                ssi.run_clustering(name)
                found = ssi.result.clustering_results[name]
                results[f"SSI-cov, {name}"] = found_modes(found.Fn, found.Xi, found.Phi)
            except Exception as error:
                results[f"SSI-cov, {name}"] = found_modes([], [], np.zeros((4, 0)))
                results[f"SSI-cov, {name}"]["error"] = str(error)
            results[f"SSI-cov, {name}"]["seconds"] = seconds + time.process_time() - begun
        begun = time.process_time()
        plscf = pLSCF(name="plscf", ordmax=30, nxseg=1024, method_SD="cor")
        setup.add_algorithms(plscf)
        setup.run_by_name("plscf")
        seconds = time.process_time() - begun
        for reach in REACHES:
            name = f"pLSCF, stable poles within {reach}"
            results[name] = stable_groups(plscf.result, reach) | {"seconds": seconds}
        result_file.write_text(json.dumps(results))
        print(file.stem, {name: len(each["frequencies_hz"]) for name, each in results.items()})


def stable_groups(result, reach):  # type: ignore[no-untyped-def]
    """Modes of pLSCF: poles that pyOMA2 labels stable, linked where frequency and shape agree.

    pyOMA2 has no clustering for pLSCF; this is the rule of Magalhaes, Cunha & Caetano (2009), which
    it has for SSI: single linkage, ``|df|/f + 1 - MAC < reach``, and at least a third of the size
    of the largest group.
    """
    from scipy.cluster.hierarchy import fcluster, linkage
    from scipy.spatial.distance import squareform

    rows, columns = np.nonzero((result.Lab == 1) & np.isfinite(result.Fn_poles))
    f, z = result.Fn_poles[rows, columns], result.Xi_poles[rows, columns]
    shapes = result.Phi_poles[rows, columns]
    if len(f) < 2:
        return found_modes(f, z, shapes.T)
    unit = shapes / np.linalg.norm(shapes, axis=1)[:, None]
    assurance = np.abs(unit.conj() @ unit.T) ** 2
    distance = np.abs(f[:, None] - f) / np.maximum(f[:, None], f) + 1.0 - assurance
    np.fill_diagonal(distance, 0.0)
    distance = np.maximum(0.5 * (distance + distance.T), 0.0)
    groups = fcluster(linkage(squareform(distance), "single"), reach, "distance")
    sizes = np.bincount(groups)
    kept = [group for group in np.unique(groups) if sizes[group] >= sizes.max() / 3]
    chosen = []
    for group in kept:
        members = np.flatnonzero(groups == group)
        chosen.append(members[np.argmin(distance[np.ix_(members, members)].sum(axis=1))])
    return found_modes(f[chosen], z[chosen], shapes[chosen].T)


def run_own(folder: Path) -> None:
    from evopem.estimation.state_space.estimate import sweep_state_space_orders
    from evopem.files.json_form import save
    from evopem.validation.mode_table import mode_table

    for file in sorted(folder.glob("???.npz")):
        table_file = file.with_suffix(".table.json")
        if table_file.exists():
            continue
        y = np.load(file)["y"]
        kept = 3 * len(y) // 4
        begun = time.process_time()
        scores = sweep_state_space_orders(None, y[:kept], ORDERS, RATE, folds=False, width=3)
        table = mode_table(scores, None, y, kept)
        seconds = time.process_time() - begun
        save(table, table_file)
        print(
            f"{file.stem}: order {table.order}, {len(table.trusted)} of {len(table.modes)} modes "
            f"trusted, {seconds:.0f} s",
            flush=True,
        )


def coverage(records: int) -> None:
    """Print the share of 95 % intervals that cover the truth, order known."""
    from evopem import SearchSettings, estimate
    from evopem.estimation.state_space.estimate import sweep_state_space_orders
    from evopem.synthesis.vibrating_structure import VibratingStructure

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


def paired(found, truth):  # type: ignore[no-untyped-def]
    """Index of the true mode of each found one, -1 for a false one; each at most once."""
    from scipy.optimize import linear_sum_assignment

    frequencies = np.array(found["frequencies_hz"])
    if not len(frequencies):
        return np.empty(0, dtype=int)
    shapes = np.array([[complex(*z) for z in shape] for shape in found["shapes"]])
    shapes /= np.linalg.norm(shapes, axis=1)[:, None]
    assurance = np.abs(shapes @ truth["shapes"]) ** 2
    distance = np.abs(frequencies[:, None] / truth["frequencies_hz"] - 1.0)
    same = (distance <= SAME_FREQUENCY) & (assurance >= SAME_SHAPE)
    rows, columns = linear_sum_assignment(np.where(same, distance, 1e3))
    pairs = np.full(len(frequencies), -1)
    pairs[rows] = np.where(same[rows, columns], columns, -1)
    return pairs


def own_results(table):  # type: ignore[no-untyped-def]
    """Modes of a table: all, those of the order that BIC chose, the trusted, and by criterion."""
    chosen = {
        "all groups": list(table.modes),
        "order of BIC": [each for each in table.modes if each.order == table.order],
        "trusted": [each for each in table.modes if each.trusted],
        "trusted but for stability": [
            each for each in table.modes if not [d for d in each.doubts if "other orders" not in d]
        ],
        "trusted but for held-out tests": [
            each
            for each in table.modes
            if not [d for d in each.doubts if "validation samples" not in d]
        ],
    }
    return {
        f"evopem, {name}": found_modes(
            [each.mode.frequency_hz for each in modes],
            [each.mode.damping_ratio for each in modes],
            np.array([each.mode.shape for each in modes]).reshape(len(modes), -1).T,
        )
        for name, modes in chosen.items()
    }


def print_table(folder: Path) -> None:
    """False and missed modes of every method over the records that all have worked on."""
    from evopem.files.json_form import load
    from evopem.validation.mode_table import ModeTable

    counts: dict[str, dict[str, list[float]]] = {}
    files = [
        file
        for file in sorted(folder.glob("???.npz"))
        if file.with_suffix(".table.json").exists() and file.with_suffix(".peers.json").exists()
    ]
    true_modes = 0
    for file in files:
        truth = dict(np.load(file))
        true_modes += len(truth["frequencies_hz"])
        results = own_results(load(ModeTable, file.with_suffix(".table.json")))
        results |= json.loads(file.with_suffix(".peers.json").read_text())
        for name, found in results.items():
            pairs = paired(found, truth)
            hit = pairs >= 0
            own = counts.setdefault(
                name, {"false": [], "missed": [], "f": [], "z": [], "exact": []}
            )
            own["false"].append(int((~hit).sum()))
            own["missed"].append(len(truth["frequencies_hz"]) - int(hit.sum()))
            own["exact"].append(float(hit.all() and hit.sum() == len(truth["frequencies_hz"])))
            f, z = np.array(found["frequencies_hz"]), np.array(found["damping_ratios"])
            own["f"] += list(f[hit] / truth["frequencies_hz"][pairs[hit]] - 1.0)
            own["z"] += list(z[hit] / truth["damping_ratios"][pairs[hit]] - 1.0)
    print(f"{len(files)} records, {true_modes} true modes")
    print("| method | false | missed | all six and no other | frequency | damping |")
    print("|---|---|---|---|---|---|")
    for name, own in counts.items():
        print(
            f"| {name} | {sum(own['false'])} | {sum(own['missed'])} | {sum(own['exact']):.0f} | "
            f"{100 * np.sqrt(np.mean(np.square(own['f']))):.2f} % | "
            f"{100 * np.median(np.abs(own['z'])):.0f} % |"
        )


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("part", choices=("records", "peers", "own", "table", "coverage"))
    parser.add_argument("folder", type=Path, nargs="?", default=Path("/tmp/output_only"))
    parser.add_argument("--records", type=int, default=100)
    arguments = parser.parse_args()
    if arguments.part == "records":
        write_records(arguments.folder, arguments.records)
    elif arguments.part == "coverage":
        coverage(arguments.records)
    else:
        {"peers": run_peers, "own": run_own, "table": print_table}[arguments.part](arguments.folder)


if __name__ == "__main__":
    main()
