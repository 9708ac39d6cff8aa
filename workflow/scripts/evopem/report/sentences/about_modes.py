"""What the data say of each mode: whether it can be trusted, and why."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from evopem.figures.view import ChannelsView, PolynomialView, View
from evopem.models.modes import Mode
from evopem.report.numbers import THIN, fixed, is_number, percent, plural
from evopem.validation.mode_evidence import ModeEvidence
from evopem.validation.mode_table import JudgedMode
from evopem.validation.mode_trust import doubts

# Share of an output's energy below which a mode is not seen there.
NEGLIGIBLE = 1e-3
# Outputs that a mode is seen at and inputs that it is driven by, named at most.
NAMED = 3
_ORIGINS = {
    "input": "driven by the inputs",
    "noise": "in the noise",
    "neither": "neither in the response nor in the noise",
    "not judged": "not tested",
}


@dataclass(frozen=True)
class ModeLine:
    """A mode on the first screen: whether it can be trusted, and why."""

    mode: Mode
    trusted: bool
    why: str
    shape_doubt: str = ""  # reason not to trust its shape; empty where there is none


def mode_lines(view: View) -> list[ModeLine]:
    """Every mode with what the data say about it."""
    if isinstance(view, ChannelsView):
        return _of_channels(view)
    assert isinstance(view, PolynomialView)
    return _of_polynomial(view)


def _of_polynomial(view: PolynomialView) -> list[ModeLine]:
    """Those of the plant, then the noise filter's own.

    A pole of D is no part of the response to the input, and only modes of the plant are tested.
    """
    results = view.results
    evidence = {each.mode.pole: each for each in results.validation.modes}
    lines = []
    for mode in results.model.modes:
        if mode.pole not in evidence:
            lines.append(ModeLine(mode, False, "could not be tested on validation samples"))
            continue
        reasons = doubts(evidence[mode.pole], view.sampling_rate)
        lines.append(ModeLine(mode, not reasons, "; ".join(reasons) or _seen(evidence[mode.pole])))
    return lines + [
        ModeLine(mode, False, "of the noise filter alone, and not tested on validation samples")
        for mode in results.model.polynomials.modes_of_polynomial("d")
    ]


def _seen(evidence: ModeEvidence) -> str:
    """Where a trusted mode shows."""
    where = "the input drives it" if evidence.reached else "disturbances drive it, not the input"
    if not evidence.has_input:
        where = "it improves the prediction of validation samples"
    if not is_number(evidence.recurrence):
        return where
    return f"{where}; {fixed(100 * evidence.recurrence, 0)}{THIN}% of the other orders have it"


def _of_channels(view: ChannelsView) -> list[ModeLine]:
    deviation = view.results.prepared.estimation.inputs.std(axis=0)
    lines = []
    for judged in view.results.modes.table.modes:
        evidence = _evidence(judged, view, deviation)
        why = "; ".join([*judged.doubts, evidence])
        lines.append(ModeLine(judged.mode, not judged.doubts, why, _shape_doubt(judged)))
    return lines


def _shape_doubt(judged: JudgedMode) -> str:
    if judged.pair is None:
        return judged.shape_doubt
    return (
        f"{judged.shape_doubt}; the plane of its shape and that of mode {judged.pair + 1} is known"
    )


def _evidence(judged: JudgedMode, view: ChannelsView, deviation: np.ndarray) -> str:
    """What drives a mode, where it is seen, the model that it is of, and the orders that have it.

    ``deviation``: standard deviations of the inputs, (m,).
    """
    record, mode = view.results.modes, judged.mode
    origin = _ORIGINS[judged.origin]
    if judged.origin == "input" and len(deviation) > 1:
        driven = np.abs(mode.input_participation) * deviation
        shares = driven / max(float(driven.sum()), 1e-300)
        origin = f"driven by {_strongest(record.input_names, shares)}"
    words = [origin]
    if len(record.output_names) > 1:
        words.append(_seen_at(record.output_names, mode.output_shares))
    if judged.order != record.table.order:
        polynomial = view.results.model.orders is not None
        size = f"plant order {judged.order}" if polynomial else plural(judged.order, "state")
        words.append(f"of the model of {size}")
    words.append(f"{len(judged.orders)} of {plural(len(record.table.orders), 'order')} have it")
    return "; ".join(words)


def _seen_at(outputs: tuple[str, ...], shares: np.ndarray) -> str:
    if shares.max() < NEGLIGIBLE:
        return f"below {percent(100.0 * NEGLIGIBLE, 1)} of the energy of every output"
    return f"seen at {_strongest(outputs, shares)}"


def _strongest(names: tuple[str, ...], shares: np.ndarray) -> str:
    """The channels with the largest shares, in percent."""
    best = [k for k in np.argsort(-shares, kind="stable")[:NAMED] if shares[k] >= NEGLIGIBLE]
    return ", ".join(f"{names[k]} {percent(100.0 * float(shares[k]), 2)}" for k in best)
