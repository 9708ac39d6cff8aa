"""The chapter's three evolutionary rivals, with Bäck's (1996) readings of their short names.

DEAP has the parts but not the algorithms: its loops recombine *or* mutate an individual where
Schwefel's evolution strategy does both, its proportional selection cannot minimise, and it knows
neither a scaling window nor evolutionary programming's tournament.  Each takes an objective of
whole populations and runs until that objective ends it.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Values = Callable[[Array], Array]

# Smallest step size and variance that self-adaptation may reach.
SMALLEST_STEP = 1e-12
SMALLEST_VARIANCE = 1e-12


@dataclass(frozen=True)
class Box:
    """The cube in which a first population is drawn."""

    dimension: int
    low: float = -np.pi
    high: float = np.pi

    def draw(self, count: int, generator: np.random.Generator) -> Array:
        """Points uniform in the box, (count, n)."""
        return generator.uniform(self.low, self.high, (count, self.dimension))


def evolution_strategy(
    values: Values,
    box: Box,
    generator: np.random.Generator,
    mu: int = 15,
    lambda_: int = 100,
    first_step: float = 3.0,
    recombination: bool = True,
) -> None:
    """(mu + lambda) evolution strategy with n self-adaptive step sizes (Schwefel; Bäck 1996).

    Each offspring takes each coordinate from one of two parents and each step size as the mean of
    theirs, then multiplies its step sizes by ``exp(tau' N + tau N_i)``, one N for all of them, with
    ``tau' = 1/sqrt(2n)`` and ``tau = 1/sqrt(2 sqrt(n))``, and adds normal steps of those sizes.

    Parameters
    ----------
    values : callable
        Objective of each row of an (M, n) array.
    box : Box
    generator : numpy.random.Generator
    mu, lambda_ : int
    first_step : float
        Step size of every coordinate in the first population.
    recombination : bool
        False copies one parent, as DEAP's loop does for what it mutates.
    """
    n = box.dimension
    common, own = 1.0 / np.sqrt(2.0 * n), 1.0 / np.sqrt(2.0 * np.sqrt(n))
    parents = box.draw(mu, generator)
    steps = np.full((mu, n), first_step)
    fitness = values(parents)
    while True:
        first, second = generator.integers(mu, size=(2, lambda_))
        children, sizes = parents[first], steps[first]
        if recombination:
            children = np.where(generator.random((lambda_, n)) < 0.5, children, parents[second])
            sizes = 0.5 * (sizes + steps[second])
        shared = common * generator.standard_normal((lambda_, 1))
        sizes = sizes * np.exp(shared + own * generator.standard_normal((lambda_, n)))
        sizes = np.maximum(sizes, SMALLEST_STEP)
        children = children + sizes * generator.standard_normal((lambda_, n))
        pool = np.concatenate([fitness, values(children)])
        best = np.argsort(pool, kind="stable")[:mu]
        parents = np.concatenate([parents, children])[best]
        steps = np.concatenate([steps, sizes])[best]
        fitness = pool[best]


def evolutionary_programming(
    values: Values,
    box: Box,
    generator: np.random.Generator,
    zeta: float = 6.0,
    opponents: int = 10,
    mu: int = 100,
    largest_first_variance: float = 25.0,
) -> None:
    """meta-EP: evolutionary programming with self-adaptive variances (Fogel 1992; Bäck 1996).

    Each of the mu parents has one child, ``x + sqrt(v) N`` and ``v + sqrt(zeta v) N`` coordinate by
    coordinate, a variance that falls to zero or below being set to a small one.  Of parents and
    children those mu survive that win most of their comparisons with ``opponents`` others.

    Parameters
    ----------
    values : callable
        Objective of each row of an (M, n) array.
    box : Box
    generator : numpy.random.Generator
    zeta : float
    opponents, mu : int
    largest_first_variance : float
        The first variances are uniform between 0 and this.
    """
    n = box.dimension
    parents = box.draw(mu, generator)
    variances = generator.uniform(0.0, largest_first_variance, (mu, n))
    fitness = values(parents)
    while True:
        children = parents + np.sqrt(variances) * generator.standard_normal((mu, n))
        changed = variances + np.sqrt(zeta * variances) * generator.standard_normal((mu, n))
        changed = np.maximum(changed, SMALLEST_VARIANCE)
        pool = np.concatenate([fitness, values(children)])
        survivors = tournament(pool, mu, opponents, generator)
        parents = np.concatenate([parents, children])[survivors]
        variances = np.concatenate([variances, changed])[survivors]
        fitness = pool[survivors]


def tournament(
    fitness: Array, count: int, opponents: int, generator: np.random.Generator
) -> NDArray[np.intp]:
    """Those that win most often against opponents drawn at random; of equals the better one."""
    drawn = generator.integers(len(fitness), size=(len(fitness), opponents))
    wins = np.sum(fitness[:, None] <= fitness[drawn], axis=1)
    return np.lexsort((fitness, -wins))[:count]


def genetic_algorithm(
    values: Values,
    box: Box,
    generator: np.random.Generator,
    bits: int = 30,
    mutation: float = 0.001,
    window: int = 5,
    size: int = 100,
    crossover: float = 0.6,
) -> None:
    """A genetic algorithm as GENEsYs runs it by default (Bäck 1992).

    Gray-coded variables, two-point crossover of pairs, bit mutation, and proportional selection by
    stochastic universal sampling of ``worst - f``, the worst being that of the last ``window``
    generations; no elitism.

    Parameters
    ----------
    values : callable
        Objective of each row of an (M, n) array.
    box : Box
        A variable's code words lie evenly between its ends.
    generator : numpy.random.Generator
    bits : int
        Bits of a variable, at most 62.
    mutation : float
        Probability that a bit flips.
    window : int
        Generations the scaling looks back on.
    size : int
        Individuals, an even number.
    crossover : float
        Probability that a pair exchanges what lies between two points.
    """
    n = box.dimension
    codes = generator.integers(1 << bits, size=(size, n))
    worst: deque[float] = deque(maxlen=window)
    while True:
        points = box.low + (box.high - box.low) * from_gray(codes, bits) / ((1 << bits) - 1)
        fitness = values(points)
        worst.append(float(np.max(fitness)))
        codes = codes[proportional_selection(max(worst) - fitness, generator)]
        codes = cross(codes, bits, crossover, generator)
        codes = mutate_bits(codes, bits, mutation, generator)


def from_gray(codes: NDArray[np.int64], bits: int) -> NDArray[np.int64]:
    """The whole numbers of Gray code words."""
    numbers = codes.copy()
    shift = 1
    while shift < bits:
        numbers ^= numbers >> shift
        shift *= 2
    return numbers


def proportional_selection(merit: Array, generator: np.random.Generator) -> NDArray[np.intp]:
    """As many parents as there are individuals, in random order, each as often as its merit says.

    Stochastic universal sampling (Baker 1987): each number of copies is the expected one, rounded
    up or down.  Where nobody has any merit all are equal.
    """
    count, total = len(merit), float(np.sum(merit))
    shares = np.cumsum(merit / total if total > 0.0 else np.full(count, 1.0 / count))
    pointers = (generator.random() + np.arange(count)) / count
    chosen = np.minimum(np.searchsorted(shares, pointers, side="right"), count - 1)
    return generator.permutation(chosen)


def cross(
    codes: NDArray[np.int64], bits: int, probability: float, generator: np.random.Generator
) -> NDArray[np.int64]:
    """Two-point crossover of successive pairs, as bit strings with the first variable in front."""
    pairs, n = len(codes) // 2, codes.shape[1]
    ends = np.sort(generator.integers(n * bits + 1, size=(pairs, 2)), axis=1)
    ends[generator.random(pairs) >= probability] = 0
    # Positions between the points within each variable, and the bits at them.
    within = np.clip(ends[:, None, :] - bits * np.arange(n)[None, :, None], 0, bits)
    ones = np.int64(1)
    exchanged = (ones << (bits - within[:, :, 0])) - (ones << (bits - within[:, :, 1]))
    first, second = codes[0::2], codes[1::2]
    difference = (first ^ second) & exchanged
    crossed = np.empty_like(codes)
    crossed[0::2], crossed[1::2] = first ^ difference, second ^ difference
    return crossed


def mutate_bits(
    codes: NDArray[np.int64], bits: int, probability: float, generator: np.random.Generator
) -> NDArray[np.int64]:
    """Flip every bit with a probability, by the geometric gaps between the flips."""
    total = codes.size * bits
    mutated = codes.copy()
    position = -1
    while True:
        gaps = generator.geometric(probability, size=max(16, int(2 * total * probability)))
        positions = position + np.cumsum(gaps)
        inside = positions[positions < total]
        np.bitwise_xor.at(mutated.reshape(-1), inside // bits, np.int64(1) << (inside % bits))
        if len(inside) < len(positions):
            return mutated
        position = int(positions[-1])
