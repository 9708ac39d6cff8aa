"""The contents of ``modes.json`` of a state-space model."""

from __future__ import annotations

from dataclasses import dataclass

from evopem.models.mode_shapes import assurance
from evopem.models.modes import Mode
from evopem.models.state_space_tables import Column, shaped_modes_table
from evopem.validation.mode_table import ModeTable


@dataclass(frozen=True, eq=False)
class ModesRecord:
    """The modes of a data set with several channels, with their shapes and what speaks for them.

    Attributes
    ----------
    input_names, output_names : tuple of str
    table : ModeTable
        By frequency.
    assurance : tuple of tuples of float
        Modal assurance criterion of each pair of shapes.
    """

    input_names: tuple[str, ...]
    output_names: tuple[str, ...]
    table: ModeTable
    assurance: tuple[tuple[float, ...], ...]

    @classmethod
    def of(
        cls, table: ModeTable, input_names: tuple[str, ...], output_names: tuple[str, ...]
    ) -> ModesRecord:
        """The record of a table of modes."""
        shapes = [each.mode.shape for each in table.modes]
        matrix = tuple(
            tuple(round(assurance(one, other), 12) for other in shapes) for one in shapes
        )
        return cls(input_names, output_names, table, matrix)

    @property
    def modes(self) -> tuple[Mode, ...]:
        """The modes, trusted or not."""
        return tuple(each.mode for each in self.table.modes)

    @property
    def trusted(self) -> tuple[bool, ...]:
        """Whether there is no reason to doubt each of them."""
        return tuple(each.trusted for each in self.table.modes)

    def rows(self) -> dict[str, Column]:
        """One row for each mode and output, as ``modes.csv`` has them."""
        columns = shaped_modes_table(self.modes, self.input_names, self.output_names)
        judged = [each for each in self.table.modes for _ in self.output_names]
        evidence: dict[str, Column] = {
            "order": [each.order for each in judged],
            "recurrence": [each.recurrence for each in judged],
            "origin": [each.origin for each in judged],
            "trusted": [str(each.trusted) for each in judged],
            "doubts": ["; ".join(each.doubts) for each in judged],
            "shape_assurance": [each.mode.shape_assurance for each in judged],
            "shape_trusted": [str(each.shape_trusted) for each in judged],
            "shape_doubt": [each.shape_doubt for each in judged],
            "plane_with_mode": ["" if each.pair is None else str(each.pair + 1) for each in judged],
        }
        return columns | evidence
