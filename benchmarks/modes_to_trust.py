"""Count false and missed modes; docs/evidence/state_space.md holds the tables it prints.

    python benchmarks/modes_to_trust.py records FOLDER [--records 200] [--driven]
    PYTHON_WITH_PYOMA2 benchmarks/modes_to_trust.py peers FOLDER [--records 200]
    python benchmarks/modes_to_trust.py own FOLDER [--records 200]
    python benchmarks/modes_to_trust.py table FOLDER [--half first]

Each record is one of a random structure with six modes, two of which have a close neighbour, at
four sensors, with 5 to 30 % of white sensor noise.  Without ``--driven`` nobody measures the
forces, which act at all sensors; with it two forces are measured.  All methods get the same
samples; evopem keeps the last quarter for its held-out tests.  A mode is found where its frequency
is within 2 % of the truth and its shape has a MAC of at least 0.8 with the true one; each estimate
is paired with one true mode at most.  What is left on either side is false or missed.  Where evopem
says that a shape is not to be trusted, one row counts the mode by its frequency alone.  Planes of
two shapes are compared with that of the two true modes next to their mean frequency.

``peers`` and ``own`` leave out the records that they have results of, so that they can be stopped.
``peers`` needs ``pip install pyOMA-2==1.4.3``.
"""

from __future__ import annotations

import argparse
import json
import sys
import time
from collections import defaultdict
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np

ROOT = Path(__file__).resolve().parent.parent
sys.path[:0] = [str(ROOT / "workflow" / "scripts"), str(ROOT / "tests")]

RATE = 100.0
# What replaces the ending of a record's file in the files of results.
PEERS, OWN = ".peers.json", ".table.json"


@dataclass(frozen=True)
class Study:
    """Samples of a record; evopem's orders and starts; pyOMA2's largest order and clusterings."""

    samples: int
    orders: range
    width: int
    ssi_order: int
    clusterings: tuple[str, ...]


DRIVEN = Study(1500, range(8, 17, 2), 2, 40, ("Neu", "Kvaale", "Dederichs", "hier_avg"))
AMBIENT = Study(4000, range(6, 17, 2), 3, 60, ("Magalhaes", "Reynders", *DRIVEN.clusterings))
# Measured forces, block rows of SSI, and the largest order of pLSCF.
FORCES, BLOCK_ROWS, PLSCF_ORDER = 2, 30, 30
SAME_FREQUENCY, SAME_SHAPE = 0.02, 0.8
# Distances within which stable poles of pLSCF are linked.
REACHES = (0.02, 0.05)


def write_records(folder: Path, count: int, driven: bool) -> None:
    from vibrating_structure import random_structure

    folder.mkdir(parents=True, exist_ok=True)
    for number in range(count):
        generator = np.random.default_rng(np.random.SeedSequence(20, spawn_key=(number,)))
        structure = random_structure(generator)
        noise = generator.uniform(0.05, 0.3)
        if driven:
            u, y = structure.driven_record(DRIVEN.samples, RATE, FORCES, noise, generator)
        else:
            y = structure.ambient_record(AMBIENT.samples, RATE, noise, generator)
            u = np.empty((len(y), 0))
        np.savez(
            folder / f"{number:03d}.npz",
            u=u,
            y=y,
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


def run_peers(folder: Path, count: int) -> None:
    from pyoma2.algorithms import SSI, pLSCF
    from pyoma2.algorithms.data.run_params import Clustering
    from pyoma2.setup import SingleSetup

    for file in unfinished(folder, count, PEERS):
        record = np.load(file)
        u, y = record["u"], record["y"]
        results = {}
        setup = SingleSetup(y, fs=RATE)
        begun = time.process_time()
        study = DRIVEN if u.shape[1] else AMBIENT
        method, inputs = ("IOcov", {"U": u}) if u.shape[1] else ("cov", {})
        ssi = SSI(
            name=method, method=method, br=BLOCK_ROWS, ordmax=study.ssi_order, step=2, **inputs
        )
        setup.add_algorithms(ssi)
        setup.run_by_name(method)
        seconds = time.process_time() - begun
        results[f"SSI-{method}, read with the truth"] = read_with_truth(ssi.result, record)
        for name in study.clusterings:
            begun = time.process_time()
            try:
                ssi.add_clustering(Clustering(name=name, quick=name))
                ssi.run_clustering(name)
                found = ssi.result.clustering_results[name]
                modes = found_modes(found.Fn, found.Xi, found.Phi)
            except Exception as error:
                modes = found_modes([], [], np.zeros((4, 0))) | {"error": str(error)}
            spent = seconds + time.process_time() - begun
            results[f"SSI-{method}, {name}"] = modes | {"seconds": spent}
        begun = time.process_time()
        plscf = pLSCF(name="plscf", ordmax=PLSCF_ORDER, nxseg=1024, method_SD="cor")
        setup.add_algorithms(plscf)
        setup.run_by_name("plscf")
        seconds = time.process_time() - begun
        results["pLSCF, read with the truth"] = read_with_truth(plscf.result, record)
        for reach in REACHES:
            name = f"pLSCF, stable poles within {reach}"
            results[name] = stable_groups(plscf.result, reach) | {"seconds": seconds}
        file.with_suffix(PEERS).write_text(json.dumps(results))
        counts = {name: len(each["frequencies_hz"]) for name, each in results.items()}
        print(file.stem, counts, flush=True)


def records_of(folder: Path) -> list[Path]:
    """All records, in their order."""
    return sorted(folder.glob("???.npz"))


def unfinished(folder: Path, count: int, suffix: str) -> list[Path]:
    """Those of the first records that have no result, in their order."""
    files = records_of(folder)[:count]
    return [file for file in files if not file.with_suffix(suffix).exists()]


def stable_poles(result):  # type: ignore[no-untyped-def]
    """Frequencies, (m,), damping ratios and shapes, (m, ny), that pyOMA2 labels stable."""
    stable = (result.Lab == 1) & np.isfinite(result.Fn_poles)
    return result.Fn_poles[stable], result.Xi_poles[stable], result.Phi_poles[stable]


def read_with_truth(result, truth):  # type: ignore[no-untyped-def]
    """Of the poles that pyOMA2 labels stable, the one nearest to each true mode, where one is.

    The best that a reader of the stabilisation diagram can do: no false mode is possible.
    """
    f, z, shapes = stable_poles(result)
    if not len(f):
        return found_modes([], [], np.zeros((shapes.shape[1], 0)))
    size = np.linalg.norm(shapes, axis=1)
    assurance = (np.abs(shapes @ truth["shapes"]) / size[:, None]) ** 2
    distance = np.abs(f[:, None] / truth["frequencies_hz"] - 1.0)
    distance[(assurance < SAME_SHAPE) | (distance > SAME_FREQUENCY)] = np.inf
    chosen = [column.argmin() for column in distance.T if np.isfinite(column).any()]
    return found_modes(f[chosen], z[chosen], shapes[chosen].T)


def stable_groups(result, reach):  # type: ignore[no-untyped-def]
    """Modes of pLSCF: poles that pyOMA2 labels stable, linked where frequency and shape agree.

    pyOMA2 has no clustering for pLSCF; this is the rule of Magalhaes, Cunha & Caetano (2009), which
    it has for SSI: single linkage, ``|df|/f + 1 - MAC < reach``, and at least a third of the size
    of the largest group.
    """
    from scipy.cluster.hierarchy import fcluster, linkage
    from scipy.spatial.distance import squareform

    f, z, shapes = stable_poles(result)
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


def run_own(folder: Path, count: int) -> None:
    from evopem.estimation.state_space.estimate import estimates_of_orders
    from evopem.files.json_form import save
    from evopem.signals.recording import recording_of
    from evopem.validation.mode_evidence import mode_table

    for file in unfinished(folder, count, OWN):
        record = np.load(file)
        y = record["y"]
        u = record["u"] if record["u"].shape[1] else None
        study = AMBIENT if u is None else DRIVEN
        kept = 3 * len(y) // 4
        begun = time.process_time()
        recording = recording_of(u, y, RATE)
        estimates = estimates_of_orders(
            recording.between(0, kept),
            study.orders,
            structure="ss" if u is None else "ss_oe",
            width=study.width,
        )
        table = mode_table(list(estimates), recording, kept)
        seconds = time.process_time() - begun
        save(table, file.with_suffix(OWN))
        print(
            f"{file.stem}: order {table.order}, {len(table.trusted)} of {len(table.modes)} modes "
            f"trusted, {seconds:.1f} s",
            flush=True,
        )


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
    alike = assurance >= SAME_SHAPE
    if "by_frequency" in found:
        alike |= np.array(found["by_frequency"])[:, None]
    same = (distance <= SAME_FREQUENCY) & alike
    rows, columns = linear_sum_assignment(np.where(same, distance, 1e3))
    pairs = np.full(len(frequencies), -1)
    pairs[rows] = np.where(same[rows, columns], columns, -1)
    return pairs


def own_results(table):  # type: ignore[no-untyped-def]
    """Modes of a table: all, those of the order that BIC chose, the trusted, and by criterion."""
    from evopem.validation.mode_evidence import doubts

    def trusted_with(**known):  # type: ignore[no-untyped-def]
        """Modes that nothing speaks against, with something known instead of judged."""
        return [each for each in table.modes if not doubts(replace(each, **known), RATE)]

    chosen = {
        "all groups": list(table.modes),
        "order of BIC": [each for each in table.modes if each.order == table.order],
        "trusted": [each for each in table.modes if each.trusted],
        "trusted with their shapes": [each for each in table.modes if each.shape_trusted],
        "trusted but for stability": trusted_with(recurrence=np.nan),
        "trusted but for held-out tests": trusted_with(reached=True),
    }
    results = {
        f"evopem, {name}": found_modes(
            [each.mode.frequency_hz for each in modes],
            [each.mode.damping_ratio for each in modes],
            np.array([each.mode.shape for each in modes]).reshape(len(modes), -1).T,
        )
        for name, modes in chosen.items()
    }
    by_frequency = [not each.shape_trusted for each in chosen["trusted"]]
    results["evopem, trusted, doubted shapes by frequency"] = results["evopem, trusted"] | {
        "by_frequency": by_frequency
    }
    return results


def planes_of(table, truth):  # type: ignore[no-untyped-def]
    """Assurance, with the true plane, of each plane that a table states for a doubted shape."""
    from evopem.models.modes import plane_assurance

    found = {}
    for row, each in enumerate(table.modes):
        if each.trusted and each.pair is not None:
            pair = [table.modes[k].mode for k in sorted((row, each.pair))]
            centre = np.mean([mode.frequency_hz for mode in pair])
            nearest = np.argsort(np.abs(truth["frequencies_hz"] - centre))[:2]
            found[tuple(sorted((row, each.pair)))] = plane_assurance(
                np.column_stack([mode.shape for mode in pair]),
                truth["shapes"][:, nearest].astype(complex),
            )
    return list(found.values())


@dataclass
class Tally:
    """Modes of one method over records, and the relative errors of those that were found."""

    false: int = 0
    missed: int = 0
    exact: int = 0
    failed: int = 0
    frequency_errors: list[float] = field(default_factory=list)
    damping_errors: list[float] = field(default_factory=list)

    def add(self, found, truth) -> None:  # type: ignore[no-untyped-def]
        """Count one record."""
        pairs = paired(found, truth)
        hit = pairs >= 0
        false, missed = int((~hit).sum()), len(truth["frequencies_hz"]) - int(hit.sum())
        self.false += false
        self.missed += missed
        self.exact += false == missed == 0
        self.failed += "error" in found
        for name, errors in (
            ("frequencies_hz", self.frequency_errors),
            ("damping_ratios", self.damping_errors),
        ):
            errors += list(np.array(found[name])[hit] / truth[name][pairs[hit]] - 1.0)

    def cells(self) -> str:
        """Cells of a row of the table."""
        frequency = 100.0 * np.sqrt(np.mean(np.square(self.frequency_errors)))
        damping = 100.0 * np.median(np.abs(self.damping_errors))
        return (
            f"{self.false} | {self.missed} | {self.exact} | {frequency:.2f} % | {damping:.0f} % | "
            f"{self.failed}"
        )


def print_tables(folder: Path, half: str) -> None:
    """Every method over the records that all have worked on, and evopem over all of its own."""
    own = [file for file in records_of(folder) if file.with_suffix(OWN).exists()]
    common = [file for file in own if file.with_suffix(PEERS).exists()]
    middle = len(common) // 2
    common = {"both": common, "first": common[:middle], "second": common[middle:]}[half]
    if common:
        print_table(common, with_peers=True)
    if half == "both" and len(own) > len(common):
        print_table(own, with_peers=False)


def print_table(files: list[Path], with_peers: bool) -> None:
    """False and missed modes over some records."""
    from evopem.files.json_form import load
    from evopem.validation.mode_evidence import ModeTable

    tallies: defaultdict[str, Tally] = defaultdict(Tally)
    true_modes = doubted = 0
    planes: list[float] = []
    for file in files:
        truth = dict(np.load(file))
        true_modes += len(truth["frequencies_hz"])
        table = load(ModeTable, file.with_suffix(OWN))
        results = own_results(table)
        planes += planes_of(table, truth)
        doubted += sum(each.trusted and not each.shape_trusted for each in table.modes)
        if with_peers:
            results |= json.loads(file.with_suffix(PEERS).read_text())
        for name, found in results.items():
            tallies[name].add(found, truth)
    print(f"{len(files)} records, {true_modes} true modes")
    print("| method | false | missed | all six and no other | frequency | damping | failed |")
    print("|---|---|---|---|---|---|---|")
    for name, tally in tallies.items():
        print(f"| {name} | {tally.cells()} |")
    print(
        f"shapes of trusted modes that are doubted: {doubted}; planes stated: {len(planes)}, "
        f"assurance with the true ones at least {min(planes, default=np.nan):.3f}"
    )


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("part", choices=("records", "peers", "own", "table"))
    parser.add_argument("folder", type=Path)
    parser.add_argument("--records", type=int, default=200)
    parser.add_argument("--driven", action="store_true")
    parser.add_argument("--half", choices=("both", "first", "second"), default="both")
    arguments = parser.parse_args()
    if arguments.part == "records":
        write_records(arguments.folder, arguments.records, arguments.driven)
    elif arguments.part == "peers":
        run_peers(arguments.folder, arguments.records)
    elif arguments.part == "own":
        run_own(arguments.folder, arguments.records)
    else:
        print_tables(arguments.folder, arguments.half)


if __name__ == "__main__":
    main()
