"""The division of stretches into folds, and of the response to a single blow into parts."""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from evopem.arrays import Array
from evopem.models.states import first_samples as lead_in_of
from evopem.signals.recording import Segment, total_samples

# A stretch shorter than this is of no use.
SHORTEST_STRETCH = 20
# Samples of a record on which delays, orders and structures are compared.
MOST_SAMPLES = 6000
# Values of all channels of a large and of a long record, whose searches are shortened.
LARGE, LONG = 100_000, 40_000


@dataclass(frozen=True, eq=False)
class Fold:
    """What a model is fitted to, and what it is scored on."""

    training: tuple[Segment, ...]
    held_out: tuple[Segment, ...]
    # samples before each held-out segment, of which its initial state is known; none at the
    # beginning of a stretch
    before: tuple[Segment, ...]


def is_large(segments: Sequence[Segment], values: int = LARGE) -> bool:
    """Whether a record has so many values that searches are shortened; ``LONG`` on folds."""
    return sum(segment.inputs.size + segment.outputs.size for segment in segments) > values


def first_samples(stretches: Sequence[Segment], most: int) -> tuple[Segment, ...]:
    """The first samples of each stretch, in proportion to its length, ``most`` together."""
    total = total_samples(stretches)
    if total <= most:
        return tuple(stretches)
    kept = [max(s.samples * most // total, min(s.samples, SHORTEST_STRETCH)) for s in stretches]
    return tuple(stretch.between(0, n) for stretch, n in zip(stretches, kept, strict=True))


@lru_cache(maxsize=4)  # all candidates of a record are scored on the same folds
def folds_of(
    stretches: tuple[Segment, ...],
    count: int,
    blocks_per_fold: int,
    shortest: int,
    edges: tuple[int, ...] | None = None,
    shortest_past: float | None = None,
) -> tuple[Fold, ...]:
    """Divide stretches into ``count * blocks_per_fold`` blocks, dealt out to the folds in turn.

    Blocks are consecutive samples, about equally long over all stretches.  A fold holds out its
    blocks; what remains of a stretch between them is a stretch of the training part.  A remainder
    with fewer than ``shortest`` samples is left out of the training.

    ``count`` is the number of folds, at least 2; one block each gives contiguous folds, more give
    interleaved ones. ``edges`` are the ends of the parts of a response, each a fold of which the
    first is never held out.

    The samples before held-out ones are as many as these. With ``shortest_past`` they are at most
    a tenth of the record, from which a validation has its state: more tell that of slow poles too
    well. All of them stay where an input rests in this tenth: states that it moved earlier are
    larger than those it moves there. Where they are fewer than ``shortest_past``, the first
    held-out ones are taken to them, if as many are left. Preparations are decided without this.
    """
    total, blocks = total_samples(stretches), count * blocks_per_fold
    folds = range(count)
    if edges is None:
        edges = tuple(np.linspace(0, total, blocks + 1).round().astype(int).tolist())
    else:
        count = len(edges)
        folds = range(1, count - 1)
    starts = np.cumsum([0, *(stretch.samples for stretch in stretches)])
    owners = np.split(np.searchsorted(edges, np.arange(total), "right") - 1, starts[1:-1])
    inputs = np.concatenate([stretch.inputs for stretch in stretches])
    mean, least = inputs.mean(axis=0), LEAST_POWER * inputs.var(axis=0)
    least_past = math.ceil(shortest_past or 0)
    lead_in = total if shortest_past is None else max(lead_in_of(total), least_past)
    divided = []
    for fold in folds:
        training: list[Segment] = []
        held_out: list[Segment] = []
        before: list[Segment] = []
        for stretch, owner in zip(stretches, owners, strict=True):
            held = owner % count == fold
            cuts = np.flatnonzero(np.diff(held.astype(int))) + 1
            for begin, end in zip([0, *cuts], [*cuts, stretch.samples], strict=True):
                if held[begin]:
                    first, scored = max(2 * begin - end, 0), begin
                    last = stretch.inputs[max(begin - lead_in, first) : begin]
                    if len(last) and (np.mean((last - mean) ** 2, axis=0) >= least).all():
                        first = begin - len(last)
                    missing = least_past - (begin - first)
                    if begin and 0 < missing <= end - begin - least_past:
                        scored += missing
                    before.append(stretch.between(first, scored))
                    held_out.append(stretch.between(scored, end))
                elif end - begin >= shortest:
                    training.append(stretch.between(begin, end))
        divided.append(Fold(tuple(training), tuple(held_out), tuple(before)))
    return tuple(divided)


def joined(before: Segment, stretch: Segment) -> Segment:
    """A stretch with the samples before it."""
    u = np.concatenate([before.inputs, stretch.inputs])
    return Segment(u, np.concatenate([before.outputs, stretch.outputs]), stretch.recording)


REASON = (
    "Part of the record is silent, as before or after a single blow: the folds divide the energy of"
    " the response, and the first part, with its beginning, is always fitted."
)
"""What a report says where folds are such parts."""

# A part whose input and output both have less than this share of the power of the largest one holds
# hardly any response; this many times the power of its output is noise; the response ends at this
# share of its energy.
LEAST_POWER, ABOVE_NOISE, WHOLE_RESPONSE = 0.1, 2.0, 0.99


def response_parts(
    inputs: Array, outputs: Array, count: int, shortest: int
) -> tuple[int, ...] | None:
    """Ends of parts of equal energy of the response, the first one included.

    None where each of as many parts of equal length has input or response, there is no input, or
    the response is too short to be divided.
    """
    samples = len(outputs)
    if not inputs.size or samples < count * shortest:
        return None
    edges = np.linspace(0, samples, count + 1).round().astype(int)
    power = _power(outputs)
    of_parts = [
        np.add.reduceat(signal, edges[:-1]) / np.diff(edges) for signal in (_power(inputs), power)
    ]
    silent = np.all([of_part < LEAST_POWER * of_part.max() for of_part in of_parts], axis=0)
    if not silent.any():
        return None
    blocks = samples // shortest
    of_blocks = power[: blocks * shortest].reshape(blocks, shortest).mean(axis=1)
    noise = ABOVE_NOISE * of_parts[1][silent].min()
    response = np.cumsum(np.maximum(of_blocks - noise, 0.0))
    shares = np.r_[np.arange(1, count) / count, WHOLE_RESPONSE]
    ends = (np.searchsorted(response, shares * response[-1]) + 1) * shortest
    bounds = (0, *np.unique(ends).tolist())
    return bounds if len(bounds) > 2 else None


def _power(signals: Array) -> Array:
    """Mean power of signals at each sample, (N,), relative to that of each about its mean."""
    squares = (signals - signals.mean(axis=0)) ** 2
    mean = np.maximum(squares.mean(axis=0), np.finfo(float).tiny)
    return np.asarray(np.mean(squares / mean, axis=1))
