"""The automatic recipe on recordings of others, beside automatic peers; writes docs/evidence.

    PYTHONPATH=workflow/scripts python benchmarks/public_recordings.py --data FOLDER [--only NAME]
    PYTHONPATH=workflow/scripts python benchmarks/public_recordings.py --data FOLDER --set second

``recordings_of_others.py`` and its later parts, ``recordings_of_others_later.py``,
``recordings_of_others_latest.py``, ``recordings_of_others_newest.py`` and
``recordings_of_others_recent.py``, say where the recordings come from and how each is split.  One
that is missing is left out, with a message.

Only input, output and rate are given.  Errors are ``100 ||y - yhat|| / ||y - mean(y)||`` of
simulations of validation samples, from the initial state that their first tenth determines; those
of the peers, and where a drift was filtered, with a level that is fitted to what is scored.
Errors above 100 % count as 100 %.  A further mean has such a level of all, where no sample was
left out and nothing transformed.
"""

from __future__ import annotations

import argparse
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
from automatic_zoo import PEERS, automatic
from evidence import write_section
from recordings_of_others import Record, reserved, second, seen, third
from recordings_of_others_later import fifth, fourth, sixth
from recordings_of_others_latest import eighth, ninth, seventh, tenth
from recordings_of_others_newest import eleventh, fourteenth, thirteenth, twelfth
from recordings_of_others_recent import fifteenth

import evopem
from evopem.automatic.cross_validation.simulation import errors_simulated_on
from evopem.signals.recording import Segment

COMMAND = "benchmarks/public_recordings.py"
FURTHER = (automatic, *PEERS)
UNSEEN = "In view since; unseen"
# Reader, end of the title and note of each set.
SETS: dict[str, tuple[Callable[[Path], Iterator[Record]], str, str]] = {
    "seen": (seen, "", "All were in view"),
    "second": (second, ", second set", f"{UNSEEN} 1.01 times and 2.0 (ebbbbb8f)"),
    "reserved": (reserved, ", reserved", f"{UNSEEN} 0.92 times and 1.6 (050f00e5)"),
    "third": (third, ", third set", f"{UNSEEN} 1.00 times and 2.4 (480697e7)"),
    "fourth": (fourth, ", fourth set", f"{UNSEEN} 1.37 times and 2.2 (e0c31340)"),
    "fifth": (fifth, ", fifth set", f"{UNSEEN} 1.00 times and 1.9 (082daa19)"),
    "sixth": (sixth, ", sixth set", f"{UNSEEN} 0.91 times and 1.2 (cb5d3264)"),
    "seventh": (seventh, ", seventh set", f"{UNSEEN} 1.07 times and 1.4 (70c1f8ec)"),
    "eighth": (eighth, ", eighth set", f"{UNSEEN} 1.10 times and 2.1 (01b18d10)"),
    "ninth": (ninth, ", ninth set", f"{UNSEEN} 1.05 times and 1.7 (da10a2ca)"),
    "tenth": (tenth, ", tenth set", "Unseen"),
    "eleventh": (eleventh, ", eleventh set", "Unseen"),
    "twelfth": (twelfth, ", twelfth set", f"{UNSEEN} 1.30 times and 1.3 (1d4b496e)"),
    "thirteenth": (thirteenth, ", thirteenth set", f"{UNSEEN} 0.99 times and 1.4 (2a66cc72)"),
    "fourteenth": (fourteenth, ", fourteenth set", f"{UNSEEN} 1.08 times and 1.5 (b93b8f4a)"),
    "fifteenth": (fifteenth, ", fifteenth set", f"{UNSEEN} 0.93 times and 0.8 (4576fe0f)"),
}


def peer_errors(record: Record) -> list[float]:
    """Of the peer that chooses by its second half, and of each alone."""
    u, y = record.u[: record.estimation], record.y[: record.estimation]
    return [error_of(peer(u, y), record) for peer in FURTHER]


def error_of(model: Any, record: Record) -> float:
    """Simulation error of a model with a level that is fitted to what is scored, percent."""
    held = Segment(record.u[record.estimation :], record.y[record.estimation :])
    errors = errors_simulated_on(model, None, held, fitted_level=True)[:, 0]
    scored = held.output[held.samples - len(errors) :]
    with np.errstate(all="ignore"):
        error = 100.0 * np.linalg.norm(errors) / np.linalg.norm(scored - scored.mean())
    return float(error) if np.isfinite(error) else np.inf


def own_error(found: Any, record: Record) -> float:
    """That of the report; behind a filter of a drift that of samples without it, as of peers."""
    transforms = found.results.prepared.transforms
    if not transforms.difference:
        return float(found.simulation_error_percent)
    if found.model.sampling_rate != record.rate or transforms.box_cox is not None:
        return float(found.results.recorded.simulation_error_percent)
    return error_of(found.model, record)


def levelled_error(found: Any, record: Record, own: float) -> float:
    """As of peers, with a level that is fitted to what is scored; ``own`` behind transforms."""
    transforms = found.results.prepared.transforms
    as_recorded = found.model.sampling_rate == record.rate and transforms.box_cox is None
    return error_of(found.model, record) if as_recorded else own


def main() -> None:
    """Print one row for each recording, and write all of them where none was asked for alone."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--data", type=Path, required=True, help="folder with the recordings")
    parser.add_argument("--only", default="", help="recordings whose name contains this")
    parser.add_argument("--set", choices=SETS, default="seen", help="which recordings")
    arguments = parser.parse_args()
    rows, ratios, failed = [], [], []
    read, title, note = SETS[arguments.set]
    for record in read(arguments.data):
        if arguments.only not in record.name:
            continue
        cut = record.estimation
        found = evopem.identify(
            *(record.u[:cut], record.y[:cut], record.rate),
            validation=(record.u[cut:], record.y[cut:]),
            show_progress=False,
        )
        own, others = own_error(found, record), peer_errors(record)
        defects = [c.name for c in found.checks if c.passed is False and c.grade == "defect"]
        pairs = (
            (own, others[0]),
            (own, min(others)),
            (levelled_error(found, record, own), others[0]),
        )
        ratios.append([min(ours, 100.0) / min(error, 100.0) for ours, error in pairs])
        failed.append(len(defects))
        numbers = [f"{error:.1f}" if error < 1000.0 else "over 1000" for error in (own, *others)]
        split = f"{cut}/{len(record.y) - cut}"
        rows.append((record.name, split, *numbers, found.summary.model, str(len(defects))))
        print(" | ".join(rows[-1]), "|", ", ".join(defects), flush=True)
    means = np.exp(np.mean(np.log(ratios), axis=0))
    text = (
        f"Errors, capped at 100 %, are {means[0]:.2f} times the automatic peer's, "
        f"{means[1]:.2f} times the lowest, {means[2]:.2f} times the peer's with fitted levels of "
        f"both; {np.mean(failed):.1f} defects a recording. {note}."
    )
    print(text)
    if not arguments.only:
        names = ("recording", "split", "evopem", "automatic peer", "ARX", "subspace")
        columns = (*names, "regularised", "model", "defects")
        write_section("automatic", f"Recordings of others{title}", text, COMMAND, columns, rows)


if __name__ == "__main__":
    main()
