"""What a better choice among the compared models could reach; writes docs/evidence.

    PYTHONPATH=workflow/scripts python benchmarks/ceiling_of_choice.py eleventh=FOLDER ...

Of recordings of others (``public_recordings.py``) each model that the choice knows is simulated on
the validation samples, as peers are: from the state that their first tenth determines, with a
level that is fitted to what is scored.  Errors above 100 % count as 100 %.  Which model is best is
known afterwards alone: of all, or of those whose held-out errors are at most so many times the
lowest one.
"""

from __future__ import annotations

import argparse
from collections.abc import Iterator
from pathlib import Path
from typing import Any, NamedTuple
from unittest.mock import patch

import numpy as np
from evidence import write_section
from public_recordings import SETS, error_of, levelled_error, own_error, peer_errors
from recordings_of_others import Record
from scipy.stats import spearmanr

import evopem
from evopem.automatic.fold_errors import score_of
from evopem.models.polynomial import of_signals
from evopem.pipeline import structure_search

COMMAND = "benchmarks/ceiling_of_choice.py"
NEAR = (1.05, 1.10, 1.25, 1.50, 2.0)


class Errors(NamedTuple):
    """Of one recording: the model that was reported, peers, and each compared model."""

    reported: float
    peers: list[float]
    chosen: float
    held_out: np.ndarray  # (M,), infinite where it was not scored
    bic: np.ndarray
    validation: np.ndarray

    def best(self, near: float = np.inf) -> float:
        """The lowest validation error of models with held-out errors near the lowest one."""
        known = np.isfinite(self.held_out) & (self.held_out <= near * self.held_out.min())
        return float(self.validation[known].min())

    def at(self, scores: np.ndarray) -> float:
        """The validation error of the model of the lowest score."""
        return float(self.validation[int(np.argmin(scores))])


def errors_of(record: Record) -> Errors:
    """The errors of all models; behind a decimation those of the decimated samples."""
    kept: dict[str, Any] = {}
    load, compare = structure_search.Scored.load, structure_search.compare_structures

    def loaded(*given: Any, **named: Any) -> Any:
        return kept.setdefault("scored", load(*given, **named))

    def compared(scorer: Any, searches: Any) -> Any:
        return kept.setdefault("comparison", compare(scorer, searches))

    cut = record.estimation
    with (
        patch.object(structure_search.Scored, "load", loaded),
        patch.object(structure_search, "compare_structures", compared),
    ):
        found = evopem.identify(
            *(record.u[:cut], record.y[:cut], record.rate),
            validation=(record.u[cut:], record.y[cut:]),
            show_progress=False,
        )
    prepared, plan, comparison = kept["scored"].prepared, kept["scored"].record, kept["comparison"]
    held, given = record, prepared.estimation
    if found.model.sampling_rate != record.rate:
        parts = prepared.validation.segments
        u, y = (np.concatenate([getattr(s, key) for s in parts]) for key in ("inputs", "outputs"))
        held = Record(record.name, u, y[:, 0], 0, found.model.sampling_rate)
    choice = comparison.choice("simulation")
    candidates, score = comparison.candidates, score_of(choice.kind)
    models = [of_signals(plan.in_its_units(each.model), given) for each in candidates]
    validation = np.array([error_of(model, held) for model in models])
    place = [each.name for each in candidates].index(choice.candidate.name)
    return Errors(
        levelled_error(found, record, own_error(found, record)),
        peer_errors(record),
        float(validation[place]),
        np.array([score(each) for each in candidates]),
        np.array([each.bic for each in candidates]),
        validation,
    )


def rows_of(known: list[Errors]) -> Iterator[tuple[str, str]]:
    """What is stated, and geometric means over the automatic peer's errors."""

    def mean(errors: list[float]) -> str:
        ratios = [
            min(e, 100.0) / min(k.peers[0], 100.0) for e, k in zip(errors, known, strict=True)
        ]
        return f"{np.exp(np.mean(np.log(ratios))):.2f}"

    scored = [np.isfinite(k.held_out) for k in known]
    better = [np.mean(k.validation[s] < k.chosen) for k, s in zip(known, scored, strict=True)]
    ranks = [
        spearmanr(k.held_out[s], k.validation[s]).statistic
        for k, s in zip(known, scored, strict=True)
    ]
    yield "reported model", mean([k.reported for k in known])
    yield "model of the lowest held-out error", mean([k.at(k.held_out) for k in known])
    yield "model of the lowest BIC", mean([k.at(k.bic) for k in known])
    for near in NEAR:
        best = mean([k.best(near) for k in known])
        yield f"best afterwards, held-out errors up to {near:.2f} times the lowest", best
    yield "best afterwards of models with held-out errors", mean([k.best() for k in known])
    yield "best afterwards of all models", mean([float(k.validation.min()) for k in known])
    yield "best afterwards of the three peers", mean([min(k.peers) for k in known])
    yield "better than the chosen one, % of models, median", f"{100 * np.median(better):.0f}"
    low, middle, high = np.nanpercentile(ranks, (25, 50, 75))
    yield (
        "rank correlation of held-out and validation errors, median (quartiles)",
        (f"{middle:.2f} ({low:.2f} to {high:.2f})"),
    )


def main() -> None:
    """Print the rows, and write them."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("sets", nargs="+", help="SET=FOLDER of each set")
    known = []
    for given in parser.parse_args().sets:
        name, folder = given.split("=")
        for record in SETS[name][0](Path(folder)):
            known.append(errors_of(record))
            print(record.name, known[-1].reported, known[-1].peers, known[-1].best(), flush=True)
    rows = list(rows_of(known))
    print(*rows, sep="\n")
    text = f"{len(known)} recordings; errors over the automatic peer's, with fitted levels."
    write_section("automatic", "Ceiling of the choice", text, COMMAND, ("model", "ratio"), rows)


if __name__ == "__main__":
    main()
