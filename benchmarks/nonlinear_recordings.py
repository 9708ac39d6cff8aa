"""Whether recordings of others are nonlinear, or change: models that evopem has no part in.

    PYTHONPATH=workflow/scripts python benchmarks/nonlinear_recordings.py --data FOLDER [FOLDER ...]

Least squares (ridge) on two banks of Laguerre filters of the input, linear and with products or
random Fourier features (Rahimi & Recht 2007), whose poles, features and penalty the last 30 % of
the estimation samples choose.  A nonlinear system is simulated better with them on validation
samples; one that changes, worse by the linear model of the other half of all samples than by one of
the same half without what it is scored on.  One folder for each set of ``public_recordings.py``.
"""

from __future__ import annotations

import argparse
from itertools import combinations_with_replacement
from pathlib import Path

import numpy as np
from evidence import write_section
from public_recordings import SETS
from scipy.signal import lfilter

FILTERS, POLES, FEATURES = 6, 7, 250
PENALTIES = (1e-4, 1e-3, 1e-2, 1e-1)
BLOCKS = 5  # of a half, each with a level of its own


def laguerre(u, pole):
    """Outputs of Laguerre filters of one pole, (N, FILTERS)."""
    outputs = [lfilter([0.0, np.sqrt(1.0 - pole**2)], [1.0, -pole], u)]
    for _ in range(FILTERS - 1):
        outputs.append(lfilter([-pole, 1.0], [1.0, -pole], outputs[-1]))
    return np.column_stack(outputs)


def features(z, kind):
    """Linear features, and squares and cubes of some or random features of all."""
    linear = np.insert(z, 0, 1.0, axis=1)
    if kind == "linear":
        return linear
    if kind == "products":
        groups = [
            c for n, most in ((2, 7), (3, 5)) for c in combinations_with_replacement(range(most), n)
        ]
        return np.clip(
            np.hstack([linear, *(np.prod(z[:, c], axis=1)[:, None] for c in groups)]), -50.0, 50.0
        )
    generator = np.random.default_rng(0)
    directions = 0.35 * generator.standard_normal((z.shape[1], FEATURES))
    return np.hstack(
        [linear, np.cos(z @ directions + generator.uniform(0.0, 2.0 * np.pi, FEATURES))]
    )


def simulated(z, y, train, kind, penalty):
    """Response of a model that is estimated on some samples, (N,)."""
    z = (z - z[train].mean(axis=0)) / (z[train].std(axis=0) + 1e-12)
    x, known = features(z, kind), 1 + z.shape[1]
    weights = np.r_[np.full(known, 1e-6), np.full(x.shape[1] - known, penalty)] * len(train)
    products = x[train].T @ x[train]
    weights += 1e-9 * np.trace(products) / len(products)
    return x @ np.linalg.solve(products + np.diag(weights), x[train].T @ y[train])


def error(y, response, blocks=1):
    """Simulation error in percent, less the mean of the errors of each block."""
    left = [e - e.mean() for e in np.array_split(y - response, blocks)]
    return 100.0 * np.linalg.norm(np.concatenate(left)) / np.linalg.norm(y - y.mean())


def of_other_half(z, y, half, other, penalty):
    """Errors on a half by models of the same half without each block, and of the other half."""
    same = np.empty(len(y))
    for block in np.array_split(half, BLOCKS):
        same[block] = simulated(z, y, np.setdiff1d(half, block), "linear", penalty)[block]
    across = simulated(z, y, other, "linear", penalty)
    return [error(y[half], each[half], BLOCKS) for each in (same, across)]


def row_of(record):
    """Errors of linear and nonlinear models, and of linear models of both halves."""
    cut = record.estimation
    u, y = ((x - x[:cut].mean(axis=0)) / x[:cut].std(axis=0) for x in (record.u, record.y))
    inputs, poles = u.reshape(len(y), -1).T, np.exp(-1.0 / np.geomspace(1.5, cut / 25, POLES))
    banks = [np.hstack([laguerre(each, pole) for each in inputs]) for pole in poles]
    pairs = [np.hstack([banks[i], banks[j]]) for i in range(POLES) for j in range(i + 1, POLES, 2)]
    first = np.arange(cut // 20, cut)
    train, test = np.split(first, [int(0.7 * len(first))])

    def chosen(banks, kinds, penalties):
        tried = [(z, kind, p) for z in banks for kind in kinds for p in penalties]
        return sorted(
            tried, key=lambda each: error(y[test], simulated(each[0], y, train, *each[1:])[test])
        )

    linear = chosen(pairs, ["linear"], [1e-6])
    best = [z for z, *_ in linear[:4]]
    errors = [
        error(y[cut:], simulated(z, y, first, kind, penalty)[cut:])
        for z, kind, penalty in (linear[0], chosen(best, ["products", "random"], PENALTIES)[0])
    ]
    halves = np.array_split(np.arange(cut // 20, len(y)), 2)
    for half, other in (halves, halves[::-1]):
        errors += of_other_half(linear[0][0], y, half, other, 1e-6)
    return [record.name, *(f"{e:.1f}" if e < 1000.0 else "over 1000" for e in errors)]


def main():
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--data", type=Path, nargs=len(SETS), required=True)
    rows = []
    for folder, (read, *_) in zip(parser.parse_args().data, SETS.values(), strict=True):
        for record in read(folder):
            rows.append(row_of(record))
            print(rows[-1], flush=True)
    write_section(
        "checks",
        "Recordings of others by nonlinear models",
        "Simulation errors (%) of Laguerre models: on validation samples without and with nonlinear"
        " terms; on each half by linear models of the same and of the other.",
        "benchmarks/nonlinear_recordings.py",
        ("recording", "linear", "nonlinear", "first half", "by second", "second half", "by first"),
        rows,
    )


if __name__ == "__main__":
    main()
