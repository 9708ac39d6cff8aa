"""Modes of other likely models beside those of the chosen one, which may describe two by one."""

from dataclasses import replace

from evopem.models.mode_matching import OF_RIVAL, PERSISTENT_ORDERS, may_be, mode_distance
from evopem.models.modes import assurances
from evopem.models.states import VERY_STRONG
from evopem.validation.mode_evidence import ModeTable


def beside_rival(table: ModeTable, rival: ModeTable, name: str, gain: float) -> ModeTable:
    """A table beside that of another model, whose BIC of all samples is less by ``gain``.

    Its trusted modes that the table lacks are added, where three orders have them, or take the
    place of the same ones in doubt.  Where there is very strong evidence for it (Kass & Raftery
    1995) and its order is lower, modes are in doubt that have none of its modes near them.
    """
    rows, modes = list(table.modes), [row.mode for row in rival.modes]
    if rival.order < table.order and gain > VERY_STRONG:
        why = f"is not in {name}, which is smaller and far likelier"
        for k, row in enumerate(rows):
            doubted = replace(row, doubts=(*row.doubts, why))
            rows[k] = row if may_be(row.mode, modes) else doubted
    known = [row.mode for row in rows if row.trusted]
    for row in rival.modes:
        apart = all(mode_distance(row.mode, mode) > OF_RIVAL for mode in known)
        if row.trusted and apart and len(row.orders) >= PERSISTENT_ORDERS:
            same = (k for k, old in enumerate(rows) if mode_distance(row.mode, old.mode) <= 1.0)
            place = next(same, len(rows))
            rows[place : place + 1] = [replace(row, model=name)]
    if any(row.model == name for row in rows):  # planes of pairs are those of one model
        alone = [replace(row, pair=None) for row in rows]
        rows = sorted(alone, key=lambda row: row.mode.frequency_hz)
    alike = assurances([row.mode.shape for row in rows])
    return replace(table, modes=tuple(rows), assurance=alike)
