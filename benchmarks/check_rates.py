"""False alarms and power of the statistics behind the checks; writes docs/evidence/checks.md.

    python benchmarks/check_rates.py [--records 200] [--processes 2] [--only SECTION ...]

Every record has a truth of its own, with poles and zeros drawn at random.  Rates are given in
percent with their binomial standard error.
"""

from __future__ import annotations

import argparse
import sys
import time
from collections.abc import Callable, Iterator
from concurrent.futures import Executor, ProcessPoolExecutor
from dataclasses import replace
from functools import partial
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy.signal import chirp, lfilter

ROOT = Path(__file__).resolve().parent.parent
sys.path.insert(0, str(ROOT / "workflow" / "scripts"))

from scipy.special import chdtrc  # noqa: E402

from evopem import Orders, SearchSettings, estimate  # noqa: E402
from evopem.config.settings import PreparationSettings, ScoringWindow  # noqa: E402
from evopem.estimation.delay_refinement import Fit, refine_delay  # noqa: E402
from evopem.estimation.pem.polynomial_objective import PolynomialErrors  # noqa: E402
from evopem.models.parameter_covariance import wald_p_value  # noqa: E402
from evopem.models.polynomial_states import estimate_prediction_states  # noqa: E402
from evopem.models.structures import armax_orders  # noqa: E402
from evopem.signals.preparation import prepare  # noqa: E402
from evopem.synthesis.armax import armax  # noqa: E402
from evopem.synthesis.flexible_arm import flexible_arm  # noqa: E402
from evopem.validation.held_out_tests import input_significance  # noqa: E402
from evopem.validation.mode_evidence import mode_evidence  # noqa: E402
from evopem.validation.residual_tests import (  # noqa: E402
    ljung_box_lags,
    whiteness_test,
)
from evopem.validation.split_spectra import split_spectra  # noqa: E402

Array = NDArray[np.float64]
# A small search: the optimum of a record is mostly found, and the statistics do not need more.
SEARCH = SearchSettings(objective="quadratic", mu=4, lambda_=8, nu=4, evaluations=2000)
WARM_UP = 500
ESTIMATION_SHARE = 0.7


def polynomial(generator: np.random.Generator, pairs: int, largest: float, reals: int = 0) -> Array:
    """A monic polynomial with random pairs of roots, of radius 0.5 to ``largest``."""
    radius = generator.uniform(0.5, largest, pairs)
    upper = radius * np.exp(1j * generator.uniform(0.1, np.pi - 0.1, pairs))
    real = generator.uniform(-0.8, 0.8, reals)
    return np.real(np.poly(np.concatenate([upper, np.conj(upper), real])))


def signals(
    generator: np.random.Generator, samples: int, coloured: bool, noise: float
) -> tuple[Array, Array]:
    """Input and output of a random ARMAX(4,4,3,1); ``noise`` is its share of the output's
    standard deviation relative to the response to the input, infinite for no response."""
    u, e = generator.standard_normal((2, samples + WARM_UP))
    if coloured:
        u = lfilter([1.0], [1.0, -1.6, 0.8], u)
    a = polynomial(generator, 2, 0.97)
    response = lfilter(np.r_[0.0, polynomial(generator, 1, 0.9, 1)], a, u)
    disturbance = lfilter(polynomial(generator, 1, 0.9, 1), a, e)
    if np.isinf(noise):
        y = disturbance
    else:
        y = response + noise * np.std(response) / np.std(disturbance) * disturbance
    return u[WARM_UP:], y[WARM_UP:]


def percent(hits: NDArray[np.bool_]) -> str:
    share = float(np.mean(hits))
    return f"{100 * share:.1f} ± {100 * np.sqrt(share * (1 - share) / len(hits)):.1f}"


def tests_of_whiteness(
    u: Array, y: Array, orders: tuple[int, int, int, int], objective: str
) -> tuple[float, float, float, float]:
    """p-value with the fit's own distribution, p-value with lags - na - nc degrees of freedom,
    statistic, its expected value."""
    found = estimate(u, y, orders, settings=replace(SEARCH, objective=objective))
    residuals = found.residuals[found.window.loss_start :]
    fitted = orders[0] + orders[2]
    lags = ljung_box_lags(len(residuals), fitted, 1200)
    window = found.window.residual_start, found.window.loss_start
    errors = PolynomialErrors(u, y, found.model.orders, objective, *window, 1.0, 1.0)
    jacobian = errors.jacobian_blocks(np.concatenate([found.model.parameters, found.noise_state]))
    test = whiteness_test(residuals, jacobian, lags, objective)
    classical = float(chdtrc(lags - fitted, test.statistic))
    return test.p_value, classical, test.statistic, test.expected


def whiteness_record(seed: int, noise: float, objective: str) -> tuple[float, ...]:
    key = (1, round(100 * noise), objective == "absolute")
    generator = np.random.default_rng(np.random.SeedSequence(seed, spawn_key=key))
    return tests_of_whiteness(*signals(generator, 2000, False, noise), (4, 4, 3, 1), objective)


def arm_record(seed: int, orders: tuple[int, int, int, int]) -> tuple[float, ...]:
    recording, _ = flexible_arm(seed=seed, samples=5000)
    # The transforms of the chapter's case, which are the built-in ones.
    data = prepare(recording, PreparationSettings()).estimation
    return tests_of_whiteness(data.input, data.output, orders, "absolute")


def whiteness(pool: Executor, records: int) -> Iterator[str]:
    yield "## White residuals"
    yield ""
    yield "True orders (4,4,3,1), 2000 samples; and the prepared flexible arm, absolute objective."
    yield "Share of records rejected at 5 % and 1 %, by the weighted chi-square distribution of the"
    yield "fit and by the chi-square distribution with lags − na − nc degrees of freedom."
    yield ""
    columns = ("truth", "objective", "noise / response", "5 %", "1 %", "5 %, lags − na − nc")
    columns += ("1 %, lags − na − nc", "mean statistic", "mean expected")
    yield f"| {' | '.join(columns)} |"
    yield "|---|---|---|---|---|---|---|---|---|"
    cells: list[tuple[str, str, str, Callable[[int], tuple[float, ...]], int]] = [
        (
            "ARMAX(4,4,3,1)",
            objective,
            f"{noise:g}",
            partial(whiteness_record, noise=noise, objective=objective),
            records,
        )
        for objective in ("quadratic", "absolute")
        for noise in (0.05, 1.0, 20.0)
    ]
    cells += [
        (f"arm at {orders}", "absolute", "–", partial(arm_record, orders=orders), records // 2)
        for orders in ((8, 8, 7, 3), (8, 10, 10, 3))
    ]
    for truth, objective, noise, run, count in cells:
        p = np.array(list(pool.map(run, range(1, count + 1), chunksize=4)))
        rates = [percent(p[:, k] < level) for k in (0, 1) for level in (0.05, 0.01)]
        means = f"{p[:, 2].mean():.1f} | {p[:, 3].mean():.1f}"
        yield f"| {truth} | {objective} | {noise} | {' | '.join(rates)} | {means} |"


def input_record(
    seed: int, orders: tuple[int, int, int, int] | None, samples: int, coloured: bool, noise: float
) -> tuple[float, float]:
    """p-value on held-out samples, and of the Wald test of B = 0, at given or selected orders."""
    key = (2, samples, coloured)
    generator = np.random.default_rng(np.random.SeedSequence(seed, spawn_key=key))
    u, y = signals(generator, samples, coloured, noise)
    cut = int(ESTIMATION_SHARE * samples)
    if orders is None:
        model = selected(u[:cut], y[:cut]).model
    else:
        model = estimate(u[:cut], y[:cut], orders, settings=SEARCH).model
    assert model.covariance is not None
    of_b = model.covariance.part(slice(model.orders.na, model.orders.na + model.orders.single.nb))
    return input_significance(model, u, y, cut).p_value, wald_p_value(model.b, of_b.matrix)


def selected(u: Array, y: Array) -> Fit:
    """The model of a search over delay, common order, nc and nb by BIC, as the workflow's."""
    fits: dict[Orders, Fit] = {}

    def fit(*numbers: int) -> Fit:
        orders = armax_orders(*numbers)
        if orders not in fits:
            found = estimate(
                u,
                y,
                orders,
                settings=SEARCH,
                window=ScoringWindow(12, 32),
            )
            fits[orders] = Fit(found.model, found.criteria.bic)
        return fits[orders]

    def bic(found: Fit) -> float:
        return found.bic

    delays = {nk: np.mean([fit(k, k, k, nk).bic for k in (2, 5, 8)]) for nk in range(4)}
    nk = min(delays, key=lambda delay: delays[delay])
    k = min((fit(k, k, k, nk) for k in range(2, 9)), key=bic).model.orders.na
    nc = min((fit(k, k, nc, nk) for nc in range(1, 9)), key=bic).model.orders.nc
    return min((fit(k, nb, nc, nk) for nb in range(1, 9)), key=bic)


def input_levels(pool: Executor, records: int) -> Iterator[str]:
    yield "## Significance of the input, unrelated channels"
    yield ""
    yield "The output is a random ARMA(4,3), the input independent of it. Share of records that"
    yield "pass at 1 % and 5 % on the last 30 % of the samples, and share with p < 1 % in the Wald"
    yield "test of B = 0 on the estimation samples."
    yield ""
    yield "| orders | samples | input | held out, 1 % | held out, 5 % | Wald, 1 % | not judged |"
    yield "|---|---|---|---|---|---|---|"
    for orders in ((6, 6, 6, 1), (8, 8, 8, 1), (6, 2, 2, 1), (2, 6, 1, 1), None):
        for samples in (1000, 4000):
            for coloured in (False, True):
                if orders is None and (samples == 4000 or coloured):
                    continue
                run = partial(
                    input_record, orders=orders, samples=samples, coloured=coloured, noise=np.inf
                )
                p = np.array(list(pool.map(run, range(records), chunksize=4)))
                judged = p[~np.isnan(p[:, 0])]
                rates = [percent(judged[:, 0] < level) for level in (0.01, 0.05)]
                yield (
                    f"| {orders or 'selected by BIC'} | {samples} "
                    f"| {'coloured' if coloured else 'white'} | {' | '.join(rates)} "
                    f"| {percent(judged[:, 1] < 0.01)} | {len(p) - len(judged)} |"
                )


def input_power(pool: Executor, records: int) -> Iterator[str]:
    yield "## Significance of the input, related channels"
    yield ""
    yield "Random ARMAX(4,4,3,1), white input, 1000 samples of which 300 are held out; share of"
    yield "records that pass at 1 %."
    yield ""
    yield "| orders | noise / response | held out |"
    yield "|---|---|---|"
    for orders in ((4, 4, 3, 1), (8, 8, 8, 1), None):
        for noise in (3.0, 6.0, 12.0, 25.0):
            if orders is None and noise != 3.0:
                continue
            run = partial(input_record, orders=orders, samples=1000, coloured=False, noise=noise)
            count = records if orders else records // 2
            p = np.array(list(pool.map(run, range(count), chunksize=4)))
            yield f"| {orders or 'selected by BIC'} | {noise:g} | {percent(p[:, 0] < 0.01)} |"


def mode_record(seed: int, samples: int, noise: float, order: int) -> list[tuple[str, str]]:
    """What each mode is in truth and by the evidence; input mode and noise mode at random."""
    key = (3, samples, int(10 * noise))
    generator = np.random.default_rng(np.random.SeedSequence(seed, spawn_key=key))
    true = np.sort(generator.uniform(4.0, 46.0, 2))
    while np.diff(true)[0] < 5.0:
        true = np.sort(generator.uniform(4.0, 46.0, 2))
    generator.shuffle(true)
    factors = []
    for frequency in true:
        damping, w = generator.uniform(0.005, 0.04), 2.0 * np.pi * frequency / 100.0
        z = np.exp(w * complex(-damping, np.sqrt(1.0 - damping**2)))
        factors.append(np.real(np.poly([z, np.conj(z)])))
    u, e = generator.standard_normal((2, samples + 2 * WARM_UP))
    x = lfilter([0.0, 1.0, 0.5], factors[0], u)
    v = lfilter([1.0, 0.3], factors[1], e)
    y = (x + noise * np.std(x) / np.std(v) * v)[2 * WARM_UP :]
    u = u[2 * WARM_UP :]
    cut = int(ESTIMATION_SHARE * samples)
    model = estimate(u[:cut], y[:cut], (order,) * 3 + (1,), 100.0, settings=SEARCH).model
    states = estimate_prediction_states(model, u[:cut], y[:cut])
    found = []
    for evidence in mode_evidence(model, u, y, cut, states):
        near = np.abs(true - evidence.mode.frequency_hz) < 1.0
        driven = ("input", "noise")
        kind = driven[int(np.argmax(near))] if near.any() else "neither"
        if evidence.mode.damping_ratio > 0.15:
            kind = "neither"
        found.append((kind, evidence.origin))
    return found


def modes(pool: Executor, records: int) -> Iterator[str]:
    yield "## Origin of modes"
    yield ""
    yield "One mode driven by the input and one by the noise, at random frequencies; all other"
    yield "poles of the model are superfluous. Share of modes of each kind by what the tests say."
    yield ""
    yield "| order | samples | noise / response | true origin | modes | input | noise | neither |"
    yield "|---|---|---|---|---|---|---|---|"
    for order in (4, 8, 12):
        for samples, noise in ((1000, 0.3), (4000, 3.0)):
            run = partial(mode_record, samples=samples, noise=noise, order=order)
            found = [
                pair for part in pool.map(run, range(records // 2), chunksize=4) for pair in part
            ]
            for kind in ("input", "noise", "neither"):
                origins = np.array([origin for true, origin in found if true == kind])
                if len(origins) == 0:
                    continue
                rates = " | ".join(percent(origins == one) for one in ("input", "noise", "neither"))
                yield f"| {order} | {samples} | {noise:g} | {kind} | {len(origins)} | {rates} |"


def one_input(kind: str, generator: np.random.Generator, samples: int) -> Array:
    """An input of a kind that is the same throughout, or a sweep through the whole record."""
    t = np.arange(samples)
    if kind == "white noise":
        return generator.standard_normal(samples)
    if kind == "coloured noise":
        return lfilter([1.0], [1.0, -1.6, 0.8], generator.standard_normal(samples))
    if kind == "narrow-band noise":
        return lfilter([1.0], [1.0, -1.9, 0.98], generator.standard_normal(samples))
    if kind == "PRBS, held 5 samples":
        return np.repeat(generator.choice([-1.0, 1.0], samples // 5 + 1), 5)[:samples]
    if kind == "two sines":
        f = generator.uniform(0.01, 0.49, 2)
        return np.sin(2 * np.pi * f[0] * t) + np.sin(2 * np.pi * f[1] * t)
    if kind == "multisine, 60 lines":
        phases = generator.uniform(0, 2 * np.pi, (60, 1))
        return np.cos(2 * np.pi * np.arange(1, 61)[:, None] * t / 500 + phases).sum(axis=0)
    if kind == "six sweeps":
        return np.tile(chirp(t[: samples // 6] / 100, 1, samples / 600, 40), 7)[:samples]
    noise = 0.05 * generator.standard_normal(samples)
    return chirp(t / 100, 1, samples / 100, 40) + noise


def split_record(seed: int, kind: str) -> bool:
    generator = np.random.default_rng(np.random.SeedSequence(seed, spawn_key=(4,)))
    samples = int(generator.choice([400, 1000, 5000]))
    cut = int(generator.choice([0.3, 0.5, 0.7, 0.85]) * samples)
    u = one_input(kind, generator, samples)
    return split_spectra(u[:cut], u[cut:], 100.0).comparable is False


def splits(pool: Executor, records: int) -> Iterator[str]:
    yield "## Spectra of the two parts of a split"
    yield ""
    yield "400, 1000 or 5000 samples, cut at 30, 50, 70 or 85 %. Share of records called not"
    yield "comparable: false alarms but for the last row."
    yield ""
    yield "| input | not comparable |"
    yield "|---|---|"
    kinds = (
        "white noise",
        "coloured noise",
        "narrow-band noise",
        "PRBS, held 5 samples",
        "two sines",
        "multisine, 60 lines",
        "six sweeps",
        "one noisy sweep, cut in time",
    )
    for kind in kinds:
        hits = np.array(list(pool.map(partial(split_record, kind=kind), range(records))))
        yield f"| {kind} | {percent(hits)} |"


def delay_record(seed: int) -> tuple[int, Orders]:
    recording, _ = armax(seed=seed, samples=4500)

    def fit(orders: Orders) -> Fit:
        found = estimate(
            recording.input,
            recording.output,
            orders,
            settings=SEARCH,
            window=ScoringWindow(20, 120),
        )
        return Fit(found.model, found.criteria.bic)

    start = min((fit(armax_orders(7, 7, 7, nk)) for nk in (2, 3, 4)), key=lambda found: found.bic)
    end = refine_delay(start, 4380, 2, fit).fit
    return start.model.orders.single.nk, end.model.orders


def delays(pool: Executor, records: int) -> Iterator[str]:
    count = min(records, 60)
    found = list(pool.map(delay_record, range(1, count + 1), chunksize=2))
    yield "## Delay where the common order leaves slack"
    yield ""
    yield f"ARMAX(7,6,7,3), {count} records of 4500 samples, models (7,7,7,nk) with nk = 2, 3, 4."
    right = np.array([nk == 3 for nk, _ in found])
    exact = np.array([orders == armax_orders(7, 6, 7, 3) for _, orders in found])
    yield f"The smallest BIC has the true delay in {percent(right)} % of the records; after the"
    yield f"refinement the orders are exact in {percent(exact)} %."


SECTIONS: dict[str, Callable[[Executor, int], Iterator[str]]] = {
    "whiteness": whiteness,
    "levels": input_levels,
    "power": input_power,
    "modes": modes,
    "splits": splits,
    "delays": delays,
}


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--records", type=int, default=200)
    parser.add_argument("--processes", type=int, default=2)
    parser.add_argument("--only", nargs="*", choices=SECTIONS, default=list(SECTIONS))
    arguments = parser.parse_args()
    lines = [
        "# False alarms and power of the checks' statistics",
        "",
        f"Written by `python benchmarks/check_rates.py --records {arguments.records}`. Every",
        "record has a truth of its own, with poles and zeros drawn at random. Rates in percent,",
        "with their binomial standard error.",
    ]
    with ProcessPoolExecutor(arguments.processes) as pool:
        for name in arguments.only:
            began = time.monotonic()
            lines.append("")
            for line in SECTIONS[name](pool, arguments.records):
                lines.append(line)
                print(line, flush=True)
            print(f"({name}: {time.monotonic() - began:.0f} s)", flush=True)
    if list(arguments.only) == list(SECTIONS):
        target = ROOT / "docs" / "evidence" / "checks.md"
        target.write_text("\n".join(lines) + "\n", encoding="utf-8")


if __name__ == "__main__":
    main()
