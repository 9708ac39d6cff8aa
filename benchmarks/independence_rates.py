"""False alarms and power of the check that residuals are independent of the input.

    python benchmarks/independence_rates.py [--records 300]

Residuals are noise, white or of an autoregression of first order, and for the power a response to
the input that a model would have missed.  Writes docs/evidence/checks.md.
"""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

import numpy as np
from evidence import write_section
from scipy.signal import lfilter

sys.path.insert(0, str(Path(__file__).resolve().parent.parent / "workflow" / "scripts"))

from evopem.validation.checks.check import largest_by_chance
from evopem.validation.checks.residuals import are_independent
from evopem.validation.residual_tests import correlation_with_input

COMMAND = "benchmarks/independence_rates.py"
SAMPLES = (500, 1000, 4000)
# Share of the variance of the residuals that the missed response has.
MISSED = {500: 0.06, 1000: 0.04, 4000: 0.01}
# Least share of correlations inside their bounds, which was required before.
INSIDE = 0.9
Array = np.ndarray


def held(steps: int, levels: str):
    """Inputs that rest for some samples on levels of a kind."""

    def draw(generator: np.random.Generator, samples: int) -> Array:
        count = samples // steps + 1
        binary = levels == "binary"
        drawn = generator.choice([-1.0, 1.0], count) if binary else generator.normal(size=count)
        return np.repeat(drawn, steps)[:samples]

    return draw


def slow(generator: np.random.Generator, samples: int) -> Array:
    """An autoregression with a pole at 0.98."""
    return lfilter([1.0], [1.0, -0.98], generator.normal(size=samples + 500))[500:]


INPUTS = {
    "white": held(1, "normal"),
    "binary, held for 5 samples": held(5, "binary"),
    "steps of 50 samples": held(50, "normal"),
    "steps of 200 samples": held(200, "normal"),
    "pole at 0.98": slow,
}


def missed_response(u: Array, generator: np.random.Generator) -> Array:
    """Response to an input by a pole between 0.5 and 0.98 and a delay, of unit variance."""
    response = lfilter([1.0], [1.0, -generator.uniform(0.5, 0.98)], u)
    response = np.roll(response, int(generator.integers(1, 20)))
    return (response - response.mean()) / response.std()


def failures(name: str, samples: int, share: float, records: int) -> Array:
    """Percent of records that the rule before and the one of today reject."""
    rejected = np.zeros(2)
    for number in range(records):
        key = [list(INPUTS).index(name), samples, number]
        generator = np.random.default_rng(np.random.SeedSequence(key))
        u = INPUTS[name](generator, samples)
        noise = generator.normal(size=samples + 300)
        e = lfilter([1.0], [1.0, -0.9 * (number % 2)], noise)[300:]
        if share:
            e = e + np.sqrt(share) * e.std() * missed_response(u, generator)
        pair = correlation_with_input(e, u)
        lags = int(pair.lag[-1])
        small = pair.largest_ratio <= largest_by_chance(2 * lags + 1)
        rejected += (
            not (small and pair.share_inside >= INSIDE),
            not are_independent(pair.largest_ratio, pair.p_value, lags),
        )
    return 100.0 * rejected / records


def main() -> None:
    """Measure all inputs and lengths, and write the section."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--records", type=int, default=300)
    records = parser.parse_args().records
    rows = []
    for name in INPUTS:
        cells = []
        for share_of in (lambda _: 0.0, MISSED.get):
            for samples in SAMPLES:
                before, now = failures(name, samples, share_of(samples), records)
                cells.append(f"{before:.1f}/{now:.1f}")
        rows.append((name, *cells))
        print(*rows[-1], sep=" | ", flush=True)
    missed = ", ".join(f"{100 * share:.0f}" for share in MISSED.values())
    text = (
        f"Percent of {records} records rejected, by the share inside the bounds/the joint"
        f" distribution, without and with a response of {missed} % of the variance."
    )
    columns = ("input", *(f"{kind}, {n}" for kind in ("independent", "missed") for n in SAMPLES))
    write_section("checks", "Independence of the input", text, COMMAND, columns, rows)


if __name__ == "__main__":
    main()
