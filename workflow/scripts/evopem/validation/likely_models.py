"""Modes of other likely models beside those of the chosen one, which may describe two by one."""

from collections.abc import Sequence
from dataclasses import replace

from evopem.models.mode_matching import OF_RIVAL, PERSISTENT_ORDERS, may_be, mode_distance
from evopem.models.modes import assurances
from evopem.models.states import VERY_STRONG
from evopem.validation.mode_evidence import ModeEvidence, ModeTable


def beside_rival(table: ModeTable, rival: ModeTable, name: str, gain: float) -> ModeTable:
    """A table beside that of another model, whose BIC of all samples is less by ``gain``.

    Its trusted modes that the table lacks are added, where three orders have them, or take the
    place of the same ones in doubt.  Where there is very strong evidence for it (Kass & Raftery
    1995) and its order is lower, modes are in doubt that have none of its modes near them.
    """
    rows: Sequence[ModeEvidence] = table.modes
    if rival.order < table.order and gain > VERY_STRONG:
        rows = _doubted(rows, rival, f"is not in {name}, which is smaller and far likelier")
    rows = _with_modes_of(rows, rival, name)
    alike = assurances([row.mode.shape for row in rows])
    return replace(table, modes=tuple(rows), assurance=alike)


def _doubted(rows: Sequence[ModeEvidence], rival: ModeTable, why: str) -> list[ModeEvidence]:
    """The modes, those in doubt that have none of another model near them."""
    modes = [row.mode for row in rival.modes]
    return [
        row if may_be(row.mode, modes) else replace(row, doubts=(*row.doubts, why)) for row in rows
    ]


def _with_modes_of(
    rows: Sequence[ModeEvidence], rival: ModeTable, name: str
) -> Sequence[ModeEvidence]:
    """The modes with the trusted ones of another model that are apart from theirs."""
    known, joined = [row.mode for row in rows if row.trusted], list(rows)
    for row in rival.modes:
        apart = all(mode_distance(row.mode, mode) > OF_RIVAL for mode in known)
        if row.trusted and apart and len(row.orders) >= PERSISTENT_ORDERS:
            same = (k for k, old in enumerate(joined) if mode_distance(row.mode, old.mode) <= 1.0)
            place = next(same, len(joined))
            joined[place : place + 1] = [replace(row, model=name)]
    if not any(row.model == name for row in joined):
        return rows
    # Planes of pairs are those of one model.
    alone = [replace(row, pair=None) for row in joined]
    return sorted(alone, key=lambda row: row.mode.frequency_hz)
