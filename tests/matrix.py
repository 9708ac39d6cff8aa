"""Every structure with every number of channels and recordings, focus, objective and constraint.

Each cell is estimated and compared with the truth, or refused by a sentence that says why: by
``evopem.estimate`` in ``estimation/test_matrix.py``, from a configuration, the terminal and by
``evopem.identify`` in ``terminal/test_matrix.py``.
"""

from itertools import combinations, product

import numpy as np
from scipy.signal import lfilter

import evopem
from evopem.config.constraints import Constraints

RATE = 10.0
FREQUENCIES = np.linspace(0.1, 4.5, 12)
POLE, GAINS, DELAYS = 0.7, ((1.0, -0.6), (0.5, 0.8)), (1, 2)
SAMPLES, NOISE = 150, 0.01

POLYNOMIALS = {
    "fir": {"nb": 18},
    "impulse": {"nb": 18},
    "arx": {"na": 1, "nb": 1},
    "armax": {"na": 1, "nb": 1, "nc": 1},
    "ararx": {"na": 1, "nb": 1, "nd": 1},
    "ararmax": {"na": 1, "nb": 1, "nc": 1, "nd": 1},
    "oe": {"nb": 1, "nf": 1},
    "bj": {"nb": 1, "nc": 1, "nd": 1, "nf": 1},
    "general": {"na": 1, "nb": 1, "nc": 1, "nd": 1, "nf": 1},
}
STATE_SPACE = ("ss", "ss_oe", "ss_oe_drift", "ss_bj")
FOCUS = ("prediction", "simulation", 3)
OBJECTIVES = ("quadratic", "absolute")
CONSTRAINTS = (None, Constraints(max_pole_radius=0.95))

# Why a cell may be refused: what the sentence says.
TWO_NOISE_MODELS = "has poles of the plant and of its noise model in one matrix"
ONE_OUTPUT = "a polynomial model has one output"
NO_POLES = "has no plant with poles"
OWN_PRIOR = "has a prior of its own alone"
WITHOUT_GAIN = "errors of simulation do not depend on the gain K"


def record(inputs, outputs, recordings, samples=SAMPLES):
    """``y_i = sum_k g_ik q^-n_k / (1 - 0.7 q^-1) u_k`` with 1 % noise, about own levels."""
    parts = []
    for number in range(recordings):
        generator = np.random.default_rng([inputs, outputs, number])
        u = generator.standard_normal((samples, inputs))
        y = np.zeros((samples, outputs))
        for i, k in product(range(outputs), range(inputs)):
            b = np.zeros(DELAYS[k] + 1)
            b[-1] = GAINS[i][k]
            y[:, i] += lfilter(b, [1.0, -POLE], u[:, k])
        y += NOISE * y.std(axis=0) * generator.standard_normal(y.shape)
        parts.append((u, y + 5.0 - 2.0 * number))
    starts = tuple(samples * number for number in range(recordings))
    return evopem.Recording(
        *(np.concatenate(each) for each in zip(*parts, strict=True)),
        RATE,
        segment_starts=starts,
        segment_recordings=tuple(range(recordings)),
    )


def truth(inputs, outputs):
    """The response at :data:`FREQUENCIES`, (frequencies, outputs, inputs)."""
    z = np.exp(2j * np.pi * FREQUENCIES / RATE)[:, None, None]
    delays = np.array(DELAYS[:inputs])
    gains = np.array(GAINS)[:outputs, :inputs]
    return gains * z**-delays / (1.0 - POLE / z)


def orders_of(structure, inputs, outputs):
    if structure in STATE_SPACE:
        # One pole, and as many states with it as the matrix of gains has independent columns.
        return {"n": min(inputs, outputs), "nk": list(DELAYS[:inputs])}
    return POLYNOMIALS[structure] | {"nk": list(DELAYS[:inputs]) if inputs > 1 else DELAYS[0]}


# Cells that are estimated, of 96.
FEWEST = dict.fromkeys(POLYNOMIALS, 48) | {"fir": 24, "impulse": 24}
FEWEST |= {"ss": 64, "ss_oe": 96, "ss_oe_drift": 96, "ss_bj": 48}


def refused(structure, outputs, focus, constraints):
    """What a cell is refused for; None where it is estimated."""
    if structure == "ss_bj" and constraints is not None:
        return TWO_NOISE_MODELS
    if structure == "ss" and focus == "simulation":
        return WITHOUT_GAIN
    if structure in STATE_SPACE:
        return None
    if outputs > 1:
        return ONE_OUTPUT
    reasons = {"fir": NO_POLES, "impulse": OWN_PRIOR}
    return reasons.get(structure) if constraints is not None else None


def cells_of(structure):
    """Every cell of a structure with the reason for which it is refused, or None."""
    for cell in product((1, 2), (1, 2), (1, 2), FOCUS, OBJECTIVES, CONSTRAINTS):
        _, outputs, _, focus, _, constraints = cell
        yield cell, refused(structure, outputs, focus, constraints)


def covering_pairs(cells):
    """A few of the cells that hold every pair of values that any of them holds, chosen greedily."""

    def pairs(cell):
        factors, reason = cell
        return set(combinations(enumerate(map(str, (*factors, reason))), 2))

    waiting = set().union(*map(pairs, cells))
    while waiting:
        chosen = max(cells, key=lambda cell: len(waiting & pairs(cell)))
        waiting -= pairs(chosen)
        yield chosen
