"""Every structure with every number of channels and recordings, focus, objective and constraint.

A configuration, the command and a call from Python accept the same cells, and refuse the others
with the same sentence. Nothing is fitted.
"""

from itertools import product

import numpy as np
import pytest
import yaml

import evopem
from evopem.config.constraints import Constraints
from evopem.config.defaults import complete
from evopem.config.structures import STATE_SPACE_FORMS, STRUCTURES, is_polynomial
from evopem.errors import InputError
from evopem.terminal.command import main

CONSTRAINTS = (None, {"max_pole_radius": 0.95}, {"real_poles": "positive"})
DEMANDS = list(product(("prediction", "simulation", 3), ("quadratic", "absolute"), CONSTRAINTS))
ORDERS = dict.fromkeys(("na", "nb", "nc", "nd", "nf"), 1)
MODELS = [each for each in (*STRUCTURES, *STATE_SPACE_FORMS) if each != "arma"]


class AcceptedError(Exception):
    """All checks that come before a fit have passed."""


@pytest.fixture(autouse=True)
def no_fits(monkeypatch):
    def accepted(*_, **__):
        raise AcceptedError

    # What follows the checks of a polynomial model, and of one in state space.
    monkeypatch.setattr("evopem.notebook.estimate.orders_of", accepted)
    for name in ("searched", "_beside"):
        monkeypatch.setattr(f"evopem.estimation.state_space.estimate.{name}", accepted)


def sentence_of(call):
    """Why a call refuses, or an empty text where it comes as far as a fit."""
    try:
        call()
    except AcceptedError:
        return ""
    except InputError as error:
        return error.problem
    return ""


def keys_of(model, inputs, outputs, recordings, demand):
    focus, objective, constraints = demand
    polynomial = is_polynomial(model)
    keys = {
        "file": [f"{number}.csv" for number in range(recordings)],
        "input": [f"u{number}" for number in range(inputs)],
        "output": [f"y{number}" for number in range(outputs)],
        "structure": model if polynomial else "state_space",
        "focus": focus,
        "search": {"objective": objective},
    }
    keys |= {} if polynomial else {"form": model}
    return keys | ({} if constraints is None else {"constraints": constraints})


def from_configuration(keys):
    return sentence_of(lambda: complete({"datasets": {"cell": keys}}))


def from_python(model, inputs, outputs, recordings, demand):
    focus, objective, constraints = demand
    n = 60
    u, y = np.random.default_rng(1).standard_normal((2, n * recordings, 2))
    recording = evopem.Recording(
        *(u[:, :inputs], y[:, :outputs], 10.0),
        segment_starts=tuple(n * number for number in range(recordings)),
        segment_recordings=tuple(range(recordings)),
    )
    return sentence_of(
        lambda: evopem.estimate(
            recording,
            orders=ORDERS if is_polynomial(model) else 1,
            structure=model,
            settings=evopem.SearchSettings(objective=objective, evaluations=0),
            level=True,
            focus=focus,
            weighting="power",
            constraints=None if constraints is None else Constraints(**constraints),
        )
    )


@pytest.mark.parametrize("model", MODELS)
def test_a_configuration_and_python_accept_the_same(model):
    accepted = 0
    for cell in product((1, 2), (1, 2), (1, 2), DEMANDS):
        refused = from_python(model, *cell)
        assert from_configuration(keys_of(model, *cell)) == refused, cell
        accepted += not refused
    # Of 144: a polynomial model has one output, fir no poles that could be required, and
    # impulse a prior of its own.
    fewest = {"fir": 24, "impulse": 24, "ss": 96, "ss_bj": 48}
    assert accepted == fewest.get(model, 72 if is_polynomial(model) else 144)


@pytest.mark.parametrize("model", MODELS)
def test_the_command_accepts_the_same(model, tmp_path, monkeypatch, capsys):
    """Channels and files are its options; it takes the demands from a file of defaults.

    It completes the same keys as a configuration: a few numbers of channels and files tell.
    """
    monkeypatch.chdir(tmp_path)
    given = []

    def stopped(_, settings, *__):
        given.append(settings)
        raise KeyboardInterrupt

    monkeypatch.setattr("evopem.pipeline.identification.identify_dataset", stopped)
    for numbers, demand in product(((1, 1, 1), (2, 1, 2), (1, 2, 1)), DEMANDS):
        cell = (*numbers, demand)
        keys = keys_of(model, *cell)
        options = keys.pop("file")
        for option in ("input", "output"):
            options += [each for name in keys.pop(option) for each in (f"--{option}", name)]
        (tmp_path / "keys.yaml").write_text(yaml.safe_dump({"defaults": keys}))
        given.clear()
        main([*options, "--config", "keys.yaml"])
        refused = from_configuration(keys_of(model, *cell))
        said = capsys.readouterr().err
        assert refused in said, cell
        assert bool(given) != bool(refused), (cell, said)
