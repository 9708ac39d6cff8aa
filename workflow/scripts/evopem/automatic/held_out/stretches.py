"""The division of stretches into folds."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from evopem.signals.recording import Segment, total_samples

# A stretch shorter than this is of no use.
SHORTEST_STRETCH = 20
# Samples of a record on which delays, orders and structures are compared.
MOST_SAMPLES = 6000


@dataclass(frozen=True, eq=False)
class Fold:
    """What a model is fitted to, and what it is scored on."""

    training: tuple[Segment, ...]
    held_out: tuple[Segment, ...]
    # samples before each held-out segment, at most as many as it has; none at the beginning of a
    # stretch
    before: tuple[Segment, ...]


def first_samples(stretches: Sequence[Segment], most: int) -> tuple[Segment, ...]:
    """The first samples of each stretch, in proportion to its length, ``most`` together."""
    total = total_samples(stretches)
    if total <= most:
        return tuple(stretches)
    kept = [
        max(each.samples * most // total, min(each.samples, SHORTEST_STRETCH)) for each in stretches
    ]
    return tuple(each.between(0, n) for each, n in zip(stretches, kept, strict=True))


def folds_of(
    stretches: Sequence[Segment],
    count: int,
    blocks_per_fold: int,
    shortest: int,
    edges: Sequence[int] | None = None,
) -> tuple[Fold, ...]:
    """Divide stretches into ``count * blocks_per_fold`` blocks, dealt out to the folds in turn.

    Blocks are consecutive samples, about equally long over all stretches.  A fold holds out its
    blocks; what remains of a stretch between them is a stretch of the training part.  A remainder
    with fewer than ``shortest`` samples is left out of the training.

    ``count`` is the number of folds, at least 2; one block each gives contiguous folds, more give
    interleaved ones. ``edges`` are the ends of the parts of a response, each a fold of which the
    first is never held out.
    """
    total, blocks = total_samples(stretches), count * blocks_per_fold
    held_out = range(count)
    if edges is None:
        edges = np.linspace(0, total, blocks + 1).round().astype(int).tolist()
    else:
        count = len(edges)
        held_out = range(1, count - 1)
    return tuple(_fold(stretches, edges, fold, count, shortest) for fold in held_out)


def _fold(
    stretches: Sequence[Segment], edges: Sequence[int], fold: int, count: int, shortest: int
) -> Fold:
    """One fold holds out the blocks whose number is its own modulo the count."""
    training: list[Segment] = []
    held_out: list[Segment] = []
    before: list[Segment] = []
    first = 0
    for stretch in stretches:
        owner = np.searchsorted(edges, np.arange(first, first + stretch.samples), "right") - 1
        held = owner % count == fold
        cuts = np.flatnonzero(np.diff(held.astype(int))) + 1
        for begin, end in zip([0, *cuts], [*cuts, stretch.samples], strict=True):
            part = stretch.between(begin, end)
            if held[begin]:
                held_out.append(part)
                before.append(stretch.between(max(2 * begin - end, 0), begin))
            elif part.samples >= shortest:
                training.append(part)
        first += stretch.samples
    return Fold(tuple(training), tuple(held_out), tuple(before))
