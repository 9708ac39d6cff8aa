"""Cells of the matrix from the terminal, from a configuration and by ``evopem.identify``.

Files, options and the `defaults:` of a cell are those that a user writes, and of the stages those
up to the model run. ``evopem.identify`` of the same keys hands over the same settings.
"""

import os
from dataclasses import replace
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
import yaml
from matrix import (
    DELAYS,
    FREQUENCIES,
    POLYNOMIALS,
    RATE,
    STATE_SPACE,
    cells_of,
    covering_pairs,
    orders_of,
    record,
    truth,
)

import evopem
from evopem.estimation.model_record import load_model
from evopem.pipeline.identification import jobs
from evopem.terminal.command import main

# Of which 288 are for estimation: eight for each coefficient of two finite responses.
SAMPLES = 360
STRUCTURES = (*POLYNOMIALS, *STATE_SPACE)


def keys_of(structure, inputs, outputs, focus, objective, constraints):
    """A cell as keys of a configuration."""
    orders = orders_of(structure, inputs, outputs)
    del orders["nk"]
    keys = {"structure": structure, "orders": orders, "focus": focus}
    if structure in STATE_SPACE:
        keys |= {"structure": "state_space", "form": structure, "orders": {"nx": orders["n"]}}
    if constraints is not None:
        keys["constraints"] = {"max_pole_radius": constraints.max_pole_radius}
    delays = DELAYS[0] if inputs == 1 else [[nk, nk] for nk in DELAYS]
    return keys | {"delay": {"nk": delays}, "search": {"objective": objective, "evaluations": 1}}


def signals_of(inputs, outputs, recordings):
    """The recordings of a cell as tables."""
    data = record(inputs, outputs, recordings, SAMPLES)
    rows = np.column_stack([data.inputs, data.outputs])
    names = [*channels("u", inputs), *channels("y", outputs)]
    return [pd.DataFrame(part, columns=names) for part in np.split(rows, recordings)]


def channels(letter, count):
    return [f"{letter}{number}" for number in range(1, count + 1)]


@pytest.fixture
def handed_over(tmp_path, monkeypatch):
    """Settings that were handed over to be identified, and the model of the first of them."""
    monkeypatch.chdir(tmp_path)
    given = []

    def up_to_the_model(files, settings, *_, **__):
        given.append(settings)
        if len(given) == 1:
            for job in jobs(settings, files, with_report=False):
                job.run()
                if job.stage.name == "complete_model":
                    given.append(load_model(files.model))
                    break
        raise KeyboardInterrupt

    monkeypatch.setattr("evopem.pipeline.identification.identify_dataset", up_to_the_model)
    return given


def ended(tables, keys, inputs, outputs):
    """The exit code of the command on files of the tables, with keys as `defaults:`."""
    files = [f"r{number}.csv" for number in range(1, len(tables) + 1)]
    for file, table in zip(files, tables, strict=True):
        table.to_csv(file, index=False, float_format="%.17g")
    Path("config.yaml").write_text(yaml.safe_dump({"defaults": keys}), encoding="utf-8")
    names = [f"--input={name}" for name in channels("u", inputs)]
    names += [f"--output={name}" for name in channels("y", outputs)]
    return main([*files, *names, f"--rate={RATE}", "--config=config.yaml"])


STOPPED = 130


@pytest.mark.parametrize("structure", STRUCTURES)
def test_cells_are_estimated_or_refused_with_a_reason(structure, handed_over, capsys):
    """One estimate of each structure; with ``EVOPEM_FULL_MATRIX=1`` every cell."""
    cells = list(cells_of(structure))
    refusals, estimates = ([c for c in cells if (c[1] is None) is e] for e in (False, True))
    if not os.environ.get("EVOPEM_FULL_MATRIX"):
        place = STRUCTURES.index(structure)
        refusals, estimates = (
            list(covering_pairs(refusals)),
            [estimates[7 * place % len(estimates)]],
        )
    for (inputs, outputs, recordings, *rest), reason in refusals:
        keys = keys_of(structure, inputs, outputs, *rest)
        assert ended(signals_of(inputs, outputs, recordings), keys, inputs, outputs) == 1
        assert reason in capsys.readouterr().err
    for cell, _ in estimates:
        handed_over.clear()
        inputs, outputs, recordings, *rest = cell
        keys, tables = keys_of(structure, inputs, outputs, *rest), signals_of(*cell[:3])
        assert ended(tables, keys, inputs, outputs) == STOPPED, capsys.readouterr().err
        with pytest.raises(KeyboardInterrupt):
            evopem.identify(
                *(tables, channels("y", outputs), RATE),
                input=channels("u", inputs),
                show_progress=False,
                **keys,
            )
        settings, model, by_function = handed_over
        alike = {"name": settings.name, "source": settings.source}
        assert replace(by_function, **alike) == settings
        true, response = truth(inputs, outputs), model.frequency_response(FREQUENCIES)
        assert np.abs(response - true).max() < 0.03 * np.abs(true).max(), cell
