"""The chapter's evolutionary algorithms, against DEAP, closed forms and known theory."""

import random

import numpy as np
import pytest

from fletcher_powell import evolution
from fletcher_powell.evolution import Box


class Spent(Exception):  # noqa: N818
    pass


class Sphere:
    """Sum of squares, for so many evaluations."""

    def __init__(self, budget):
        self.left, self.best = budget, np.inf

    def __call__(self, points):
        if self.left < len(points):
            raise Spent
        self.left -= len(points)
        values = np.sum(points**2, axis=1)
        self.best = min(self.best, values.min())
        return values


def run(algorithm, budget, seed, dimension, half=100.0, **settings):
    sphere = Sphere(budget)
    box = Box(dimension, -half, half)
    with pytest.raises(Spent):
        algorithm(sphere, box, np.random.default_rng(seed), **settings)
    return np.log10(sphere.best)


def deap_strategy(seed, generations, dimension, half, first_step):
    """DEAP's (15+100) loop with its log-normal mutation, for which it has no recombination."""
    from deap import algorithms, base, creator, tools

    if not hasattr(creator, "Strategist"):
        creator.create("Lowest", base.Fitness, weights=(-1.0,))
        creator.create("Strategist", list, fitness=creator.Lowest, strategy=None)
    random.seed(seed)

    def individual():
        made = creator.Strategist(random.uniform(-half, half) for _ in range(dimension))
        made.strategy = [first_step] * dimension
        return made

    toolbox = base.Toolbox()
    toolbox.register("mate", tools.cxESBlend, alpha=0.1)
    toolbox.register("mutate", tools.mutESLogNormal, c=1.0, indpb=1.0)
    toolbox.register("select", tools.selBest)
    toolbox.register("evaluate", lambda x: (sum(value * value for value in x),))
    population = [individual() for _ in range(15)]
    population, _ = algorithms.eaMuPlusLambda(
        population, toolbox, 15, 100, cxpb=0.0, mutpb=1.0, ngen=generations, verbose=False
    )
    return np.log10(min(one.fitness.values[0] for one in population))


def test_the_evolution_strategy_progresses_as_deaps_does():
    pytest.importorskip("deap")
    dimension, half, generations, first = 5, 5.0, 30, 1.0
    theirs = [deap_strategy(seed, generations, dimension, half, first) for seed in range(8)]
    ours = [
        run(
            evolution.evolution_strategy,
            15 + 100 * generations,
            seed,
            dimension,
            half,
            first_step=first,
            recombination=False,
        )
        for seed in range(40)
    ]
    error = np.hypot(np.std(ours) / np.sqrt(len(ours)), np.std(theirs) / np.sqrt(len(theirs)))
    assert np.mean(theirs) < -3.0
    assert abs(np.mean(ours) - np.mean(theirs)) < 3.5 * error


def test_recombination_speeds_the_evolution_strategy_on_the_sphere():
    """Genetic repair (Beyer 1995): in 30 dimensions the gain is large."""
    plain, recombined = (
        np.mean(
            [
                run(evolution.evolution_strategy, 20000, seed, 30, recombination=chosen)
                for seed in range(4)
            ]
        )
        for chosen in (False, True)
    )
    assert recombined < plain - 1.0


def test_the_tournaments_wins_are_binomial():
    generator = np.random.default_rng(0)
    fitness = np.arange(40.0)
    survived = np.zeros(40)
    for _ in range(2000):
        survived[evolution.tournament(fitness, 20, 10, generator)] += 1
    assert survived.sum() == 2000 * 20
    assert survived[0] == 2000
    assert np.all(survived[:5] > 1990)
    assert np.all(survived[-5:] < 10)
    # Of two neighbours in the middle either may survive, and the better one more often.
    assert 0 < survived[24] < survived[20] < survived[15] < 2000


def test_evolutionary_programming_converges_on_the_sphere():
    early, late = (
        run(evolution.evolutionary_programming, budget, 1, 5, 5.0) for budget in (500, 10000)
    )
    assert late < early - 1.5


def test_gray_neighbours_differ_in_one_bit():
    numbers = np.arange(1 << 10, dtype=np.int64)
    codes = numbers ^ (numbers >> 1)
    assert np.array_equal(evolution.from_gray(codes, 10), numbers)
    assert {int(step).bit_count() for step in codes[1:] ^ codes[:-1]} == {1}


def test_proportional_selection_raises_the_mean_merit_as_fisher_says():
    """Without variation the mean merit grows by its variance over its mean (Fisher 1930)."""
    generator = np.random.default_rng(3)
    merit = generator.gamma(2.0, size=400)
    grown = np.mean([merit[evolution.proportional_selection(merit, generator)] for _ in range(50)])
    assert grown - merit.mean() == pytest.approx(merit.var() / merit.mean(), rel=0.02)
    copies = np.bincount(evolution.proportional_selection(merit, generator), minlength=400)
    assert np.all(np.abs(copies - merit * 400 / merit.sum()) < 1.0)


def test_without_merit_everyone_is_selected_once():
    chosen = evolution.proportional_selection(np.zeros(8), np.random.default_rng(0))
    assert sorted(chosen) == list(range(8))


def bits_of(codes, bits):
    """Bit strings, (individuals, variables * bits), the highest bit of a variable first."""
    shifts = np.arange(bits - 1, -1, -1)
    return ((codes[:, :, None] >> shifts) & 1).reshape(len(codes), -1)


def test_crossover_exchanges_one_stretch_between_two_points():
    generator = np.random.default_rng(4)
    codes = generator.integers(1 << 6, size=(400, 5))
    crossed = evolution.cross(codes, 6, 0.6, generator)
    before, after = bits_of(codes, 6), bits_of(crossed, 6)
    assert np.array_equal(before[0::2] + before[1::2], after[0::2] + after[1::2])
    changed = before[0::2] != after[0::2]
    unlike = before[0::2] != before[1::2]
    for change, differs in zip(changed, unlike, strict=True):
        places = np.flatnonzero(change)
        if len(places):
            assert np.array_equal(
                change[places[0] : places[-1] + 1], differs[places[0] : places[-1] + 1]
            )
    assert 0.4 < changed.any(axis=1).mean() < 0.6


def test_mutation_flips_bits_at_its_rate():
    generator = np.random.default_rng(5)
    codes = generator.integers(1 << 30, size=(200, 20))
    flips = [
        (bits_of(codes, 30) != bits_of(evolution.mutate_bits(codes, 30, 0.01, generator), 30))
        for _ in range(5)
    ]
    total = np.sum(flips)
    expected = 5 * 200 * 600 * 0.01
    assert abs(total - expected) < 4 * np.sqrt(expected)
    places = np.sum(flips, axis=(0, 1))
    assert places.min() > 0
    assert places.max() < 35


def test_the_genetic_algorithm_gets_closer():
    early, late = (run(evolution.genetic_algorithm, budget, 1, 5, 5.0) for budget in (200, 20000))
    assert late < early - 1.0
