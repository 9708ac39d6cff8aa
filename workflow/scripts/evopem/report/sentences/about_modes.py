"""What the data say of each mode: whether it can be trusted, and why."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from evopem.figures.view import Channel, View
from evopem.models.modes import Mode
from evopem.report.numbers import THIN, fixed, is_number, percent
from evopem.validation.mode_evidence import ModeEvidence

# Share of an output's energy below which a mode is not seen there.
NEGLIGIBLE = 1e-3
# Outputs that a mode is seen at and inputs that it is driven by, named at most.
NAMED = 3


@dataclass(frozen=True)
class ModeLine:
    """A mode on the first screen: whether it can be trusted, and why."""

    mode: Mode
    trusted: bool
    why: str
    stable: bool | None = None  # whether most models of other orders have it
    shape_doubt: str = ""  # reason not to trust its shape; empty where there is none


def mode_lines(view: View) -> list[ModeLine]:
    """Every mode of the plant with what the data say about it, then the noise filter's own.

    A pole of D is no part of the response to the inputs, and only modes of the plant are tested.
    """
    return [
        *(_line(view, mode) for mode in view.modes),
        *(
            ModeLine(mode, False, "of the noise filter alone, and not tested on validation samples")
            for mode in view.noise_modes
        ),
    ]


def _line(view: View, mode: Mode) -> ModeLine:
    evidence = view.evidence.get(mode.pole)
    if evidence is None:
        return ModeLine(mode, False, "could not be tested on validation samples")
    reasons = list(evidence.doubts)
    words = reasons or [_origin(view, evidence)]
    if reasons and len(view.inputs) > 1 and evidence.origin == "input":
        words.append(_origin(view, evidence))
    if len(view.outputs) > 1:
        words.append(_seen_at(view, mode))
    if evidence.order != view.results.validation.modes.order:
        words.append(f"of the model of order {evidence.order}")
    if not reasons and is_number(evidence.recurrence):
        words.append(f"{fixed(100 * evidence.recurrence, 0)}{THIN}% of the other orders have it")
    shape = _shape_doubt(evidence)
    return ModeLine(mode, not reasons, "; ".join(words), evidence.stable, shape)


def _origin(view: View, evidence: ModeEvidence) -> str:
    """What drives a mode, and where there are several inputs, which of them."""
    if not view.has_input:
        return "it improves the prediction of validation samples"
    if evidence.origin != "input":
        return f"disturbances drive it, not the {'input' if len(view.inputs) == 1 else 'inputs'}"
    if len(view.inputs) == 1:
        return "the input drives it"
    driven = np.abs(evidence.mode.input_participation) * view.input_deviations
    shares = driven / max(float(driven.sum()), 1e-300)
    return f"driven by {_strongest(view.inputs, shares)}"


def _seen_at(view: View, mode: Mode) -> str:
    shares = mode.output_shares
    if shares.max() < NEGLIGIBLE:
        return f"below {percent(100.0 * NEGLIGIBLE, 1)} of the energy of every output"
    return f"seen at {_strongest(view.outputs, shares)}"


def _strongest(channels: Sequence[Channel], shares: np.ndarray) -> str:
    """The channels with the largest shares, in percent."""
    best = [k for k in np.argsort(-shares, kind="stable")[:NAMED] if shares[k] >= NEGLIGIBLE]
    return ", ".join(f"{channels[k].name} {percent(100.0 * float(shares[k]), 2)}" for k in best)


def _shape_doubt(judged: ModeEvidence) -> str:
    if judged.pair is None:
        return judged.shape_doubt
    return (
        f"{judged.shape_doubt}; the plane of its shape and that of mode {judged.pair + 1} is known"
    )
