"""The three evolutionary algorithms that the chapter compares the hybrid with (Bäck 1996).

They are not taken from DEAP. Its loops recombine *or* mutate an individual, and Schwefel's
evolution strategy does both; its proportional selection cannot minimise; it has neither a scaling
window nor the tournament of evolutionary programming.  Each algorithm evaluates whole populations
and runs until the objective raises an exception.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Values = Callable[[Array], Array]

# Lower bounds of the self-adapted step sizes and variances.
SMALLEST_STEP = 1e-12
SMALLEST_VARIANCE = 1e-12


@dataclass(frozen=True)
class Box:
    """Cube in which a first population is drawn."""

    dimension: int
    low: float = -np.pi
    high: float = np.pi

    def draw(self, count: int, generator: np.random.Generator) -> Array:
        """Draw points uniform in the box, (count, n)."""
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
        False copies one parent, as DEAP's loop does.
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
    coordinate; a variance is kept at or above ``SMALLEST_VARIANCE``.  Of parents and children, the
    mu survive that win most comparisons with ``opponents`` others.

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
    """Indices of those that win most comparisons with random opponents; the better one if equal."""
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
    """Genetic algorithm with the defaults of GENEsYs (Bäck 1992).

    Gray-coded variables, two-point crossover of pairs, bit mutation, and proportional selection by
    stochastic universal sampling.  The merit is ``worst - f``, with the worst value of the last
    ``window`` generations.  No elitism.

    Parameters
    ----------
    values : callable
        Objective of each row of an (M, n) array.
    box : Box
        The code words of a variable are evenly spaced between its ends.
    generator : numpy.random.Generator
    bits : int
        Bits of a variable, at most 62.
    mutation : float
        Probability that a bit flips.
    window : int
        Generations from which the worst value is taken.
    size : int
        Individuals, an even number.
    crossover : float
        Probability of the crossover of a pair.
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
    """Decode Gray code words to whole numbers."""
    numbers = codes.copy()
    shift = 1
    while shift < bits:
        numbers ^= numbers >> shift
        shift *= 2
    return numbers


def proportional_selection(merit: Array, generator: np.random.Generator) -> NDArray[np.intp]:
    """Indices of as many parents as individuals, each in proportion to its merit, in random order.

    Stochastic universal sampling (Baker 1987): each number of copies is the expected one, rounded
    up or down.  If all merits are zero, each individual is selected once.
    """
    count, total = len(merit), float(np.sum(merit))
    shares = np.cumsum(merit / total if total > 0.0 else np.full(count, 1.0 / count))
    pointers = (generator.random() + np.arange(count)) / count
    chosen = np.minimum(np.searchsorted(shares, pointers, side="right"), count - 1)
    return generator.permutation(chosen)


def cross(
    codes: NDArray[np.int64], bits: int, probability: float, generator: np.random.Generator
) -> NDArray[np.int64]:
    """Two-point crossover of successive pairs; the bit string begins with the first variable."""
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
    """Flip every bit with a probability; gaps between flips are drawn as geometric."""
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
