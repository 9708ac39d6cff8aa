"""What do remedies for failed checks change?  docs/evidence/automatic.md and state_space.md tell.

    python benchmarks/remedies.py one [--records 6] [--first 0]
    python benchmarks/remedies.py several [--records 4] [--first 0]

Synthetic records whose first choice is likely to fail checks, some by what is given: orders
that end below the truth, a delay that is one sample too long, coloured noise, few samples.  The
model before and after the remedies simulates the noise-free output of a fresh record.  ``one``
input and output: the automatic recipe.  ``several``: the remedies after the global search of the
chosen model.
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Callable, Iterator
from dataclasses import replace
from functools import partial
from typing import Any, NamedTuple
from unittest.mock import patch

import numpy as np
from evopem.automatic.searched_forms import SearchedForms, search_variant
from evopem.automatic.searched_orders import searched_orders
from evopem.automatic.state_space_choice import choose
from evopem.automatic.variant_search import Variant
from state_space_choice import coloured, held, light_plant, recording_of, slow_plant
from threadpoolctl import threadpool_limits

from evopem.automatic import identify as recipe
from evopem.automatic import state_space_remedies as of_several
from evopem.automatic.limits import OrderLimits
from evopem.config.settings import AutomaticSettings, OrderRanges
from evopem.config.structures import VARIANTS
from evopem.estimation.delays import estimate_delays
from evopem.estimation.state_space.task import QUADRATIC
from evopem.signals.recording import Recording
from evopem.validation.multichannel import mean_errors

KINDS = ("coloured", "short", "bounded", "late")
SHORT, SAMPLES, FRESH, DELAY = 150, 500, 1000, 3
SHAPES = ((2, 2), (3, 2), (1, 3))
LARGEST_ORDER = 6


class Record(NamedTuple):
    """Inputs and measured outputs, those of a fresh record without noise, and the true order."""

    u: np.ndarray
    y: np.ndarray
    fresh_u: np.ndarray
    fresh_clean: np.ndarray
    order: int


def record(kind: str, seed: int, nu: int, ny: int) -> Record:
    """A plant of order 3 to 6 whose inputs are held and act after ``DELAY`` samples."""
    key = (KINDS.index(kind), seed, nu, ny)
    g = np.random.default_rng(np.random.SeedSequence(61, spawn_key=key))
    samples = SHORT if kind == "short" else SAMPLES
    light = g.random() < 0.5
    n = 2 * int(g.integers(2, 4)) if light else int(g.integers(3, 6))
    plant = (light_plant if light else slow_plant)(g, nu, ny, n)
    u = held(g, samples + FRESH + DELAY, nu, int(g.integers(1, 12)))
    clean = np.roll(plant.respond(u), DELAY - 1, axis=0)[DELAY:]
    u = u[DELAY:]
    pole = g.uniform(0.7, 0.95) if kind == "coloured" else g.uniform(0.0, 0.5)
    noise = coloured(g, len(u), ny, pole) * g.uniform(0.1, 0.4) * clean.std(axis=0)
    return Record(*(u[:samples], (clean + noise)[:samples]), *(u[samples:], clean[samples:]), n)


class Outcome(NamedTuple):
    """One model replaced by another, or not: errors on the fresh record in percent, and seconds."""

    remedy: str
    tried: int
    taken: bool
    failed_before: int
    failed_after: int
    before: float
    after: float
    seconds: float
    of_all: float


def timed(call: Callable[[], Any]) -> tuple[Any, float]:
    """What a call returns, and its processor seconds."""
    begun = time.process_time()
    return call(), time.process_time() - begun


def outcomes_of_one(kind: str, seed: int) -> list[Outcome]:
    """The remedies of the automatic recipe."""
    made, kept = record(kind, seed, 1, 1), []

    def recorded(scorer: Any, choice: Any) -> Any:
        result, spent = timed(partial(act, scorer, choice))
        kept.append((choice, scorer.checks(choice.candidate).failed, result, spent))
        return result

    limits = OrderLimits(joint=(1, made.order // 2)) if kind == "bounded" else OrderLimits()

    def delayed(stretches: Any, names: Any) -> Any:
        found = decide_delays(stretches, names)
        return replace(found, delays=(found.delays[0] + (kind == "late"),))

    act, decide_delays = recipe.act_on_checks, recipe.decide_delays
    with (
        patch.object(recipe, "act_on_checks", recorded),
        patch.object(recipe, "decide_delays", delayed),
        patch.object(recipe, "Scorer", partial(recipe.Scorer, limits=limits)),
    ):
        found, of_all = timed(partial(recipe.identify, made.u[:, 0], made.y[:, 0], 1.0))
    ((choice, failed, remedied, spent),) = kept
    fresh = Recording(made.fresh_u[:, 0], made.fresh_clean[:, 0], 1.0)
    before = replace(found, choice=choice).validate(fresh).simulation
    taken = remedied.choice.candidate is not choice.candidate
    return [
        Outcome(
            *("remedies", len(remedied.trials), taken, len(failed), len(remedied.failed)),
            *(before, found.validate(fresh).simulation, spent, of_all),
        )
    ]


def outcomes_of_several(kind: str, seed: int) -> list[Outcome]:
    """The remedies of a record of several channels."""
    made, kept = record(kind, seed, *SHAPES[seed % len(SHAPES)]), []
    middle_u, middle_y = made.u.mean(axis=0), made.y.mean(axis=0)
    estimation = recording_of(made.u - middle_u, made.y - middle_y)
    fresh = recording_of(made.fresh_u - middle_u, made.fresh_clean - middle_y)

    def recorded(first: Any, log: Any) -> Any:
        (last, attempts), spent = timed(partial(act, first, log))
        failed = len(first.checks.failed), len(last.checks.failed)
        errors = (
            mean_errors(each.model.model, fresh, each.choice.level == "state")[1]
            for each in (first, last)
        )
        remedy = attempts[-1].trial.remedy if last is not first else "none"
        kept.append(Outcome(remedy, len(attempts), last is not first, *failed, *errors, spent, 0.0))
        return last, attempts

    act = of_several._with_other_model
    with patch.object(of_several, "_with_other_model", recorded):
        _, of_all = timed(partial(identified, estimation, kind, made.order))
    return [each._replace(of_all=of_all) for each in kept]


def identified(estimation: Any, kind: str, order: int) -> None:
    """Delays, searches over orders, choice, and global search with remedies."""
    highest = order // 2 if kind == "bounded" else LARGEST_ORDER
    orders = [each for each in searched_orders(estimation, None) if each <= highest]
    delays = tuple(each + (kind == "late") for each in estimate_delays(estimation))
    found = {
        each: search_variant(
            *(estimation, each, delays, orders),
            QUADRATIC,
        )
        for each in (Variant(*names) for names in VARIANTS)
    }
    forms = SearchedForms(
        *(estimation, delays, tuple(search for search, _ in found.values())),
        lambda variant, order: found[variant][1].of_order(order),
        QUADRATIC,
        OrderRanges(),
    )
    of_several.act_on_checks(forms, choose(forms.searches, AutomaticSettings()).model)


def rows(outcomes_of: Callable[[str, int], list[Outcome]], seeds: range) -> Iterator[Outcome]:
    """All outcomes, each printed as it comes."""
    for kind in KINDS:
        for seed in seeds:
            for each in outcomes_of(kind, seed):
                print(
                    f"| {kind} | {each.remedy} | {each.tried} | {'yes' if each.taken else 'no'} "
                    f"| {each.failed_before} | {each.failed_after} | {each.before:.2f} "
                    f"| {each.after:.2f} | {each.seconds:.1f} | {each.of_all:.1f} |",
                    flush=True,
                )
                yield each._replace(remedy=f"{kind}, {each.remedy}")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("part", choices=("one", "several"))
    parser.add_argument("--records", type=int, default=4, help="of each kind")
    parser.add_argument("--first", type=int, default=0, help="seed of the first one")
    arguments = parser.parse_args()
    outcomes_of = outcomes_of_one if arguments.part == "one" else outcomes_of_several
    seeds = range(arguments.first, arguments.first + arguments.records)
    print(
        "| kind | remedy | tried | taken | failed before | after | error before, % | after, % "
        "| CPU s | of all |"
    )
    print("|---" * 10 + "|")
    with threadpool_limits(limits=1, user_api="blas"):
        found = list(rows(outcomes_of, seeds))
    for name in dict.fromkeys(each.remedy for each in found):
        own = [each for each in found if each.remedy == name]
        taken = np.array([each.after / each.before for each in own if each.taken])
        gain = "-"
        if taken.size:
            gain = f"{np.exp(np.log(taken).mean()):.3f} ({taken.min():.2f} to {taken.max():.2f})"
        spent = sum(each.seconds for each in own), sum(each.of_all for each in own)
        print(
            f"{name}: {len(own)} records, {len(taken)} taken, error after / before "
            f"{gain}, {spent[0]:.0f} of {spent[1]:.0f} s"
        )


if __name__ == "__main__":
    main()
