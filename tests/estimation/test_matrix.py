"""Every cell of the matrix by ``evopem.estimate``: see :mod:`matrix`."""

import os
import re

import numpy as np
import pytest
from matrix import (
    FEWEST,
    FREQUENCIES,
    POLYNOMIALS,
    STATE_SPACE,
    cells_of,
    covering_pairs,
    orders_of,
    record,
    truth,
)

import evopem


def estimated(structure, inputs, outputs, recordings, focus, objective, constraints):
    return evopem.estimate(
        record(inputs, outputs, recordings),
        orders=orders_of(structure, inputs, outputs),
        structure=structure,
        settings=evopem.SearchSettings(objective=objective, evaluations=0),
        level=True,
        focus=focus,
        weighting="power" if objective == "absolute" else "noise",
        constraints=constraints,
    )


@pytest.mark.parametrize("structure", [*POLYNOMIALS, *STATE_SPACE])
def test_cells_are_estimated_or_refused_with_a_reason(structure):
    """Cells that cover every pair of factors; every cell with ``EVOPEM_FULL_MATRIX=1``."""
    cells = list(cells_of(structure))
    refusals = [cell for cell in cells if cell[1] is not None]
    estimates = [cell for cell in cells if cell[1] is None]
    assert len(estimates) >= FEWEST[structure]
    if not os.environ.get("EVOPEM_FULL_MATRIX"):
        refusals, estimates = list(covering_pairs(refusals)), list(covering_pairs(estimates))
    for cell, reason in refusals:
        with pytest.raises((ValueError, evopem.InputError), match=re.escape(reason)):
            estimated(structure, *cell)
    for cell, _ in estimates:
        true = truth(*cell[:2])
        response = estimated(structure, *cell).model.frequency_response(FREQUENCIES)
        assert np.abs(response - true).max() < 0.03 * np.abs(true).max(), cell
