"""False alarms and power of the statistics behind the checks; writes docs/evidence/checks.md.

    python benchmarks/check_rates.py [--records 100] [--processes 2] [--only SECTION ...]

Every record has a truth of its own, with poles and zeros drawn at random.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Callable
from concurrent.futures import Executor, ProcessPoolExecutor
from dataclasses import replace
from functools import partial
from pathlib import Path

import numpy as np
from evidence import write_section
from numpy.typing import NDArray
from scipy.signal import chirp, lfilter

ROOT = Path(__file__).resolve().parent.parent
sys.path.insert(0, str(ROOT / "workflow" / "scripts"))

from scipy.special import chdtrc  # noqa: E402

from evopem import Orders, SearchSettings, estimate  # noqa: E402
from evopem.config.settings import PreparationSettings, ScoringWindow  # noqa: E402
from evopem.estimation.order_selection import Fit, refine_delay  # noqa: E402
from evopem.estimation.pem.polynomial_errors import PolynomialErrors  # noqa: E402
from evopem.models.mode_matching import OrderModel  # noqa: E402
from evopem.models.orders import armax_orders  # noqa: E402
from evopem.signals.preparation import prepare  # noqa: E402
from evopem.signals.recording import Recording, Segment  # noqa: E402
from evopem.synthesis import armax, flexible_arm  # noqa: E402
from evopem.validation.mode_evidence import table_of_models  # noqa: E402
from evopem.validation.residual_tests import (  # noqa: E402
    fit_effects,
    ljung_box_lags,
    whiteness_test,
)
from evopem.validation.responses import divided  # noqa: E402
from evopem.validation.spectra import split_spectra  # noqa: E402
from evopem.validation.validate import input_significance  # noqa: E402

Array = NDArray[np.float64]
Numbers = tuple[int, int, int, int]
COMMAND = "benchmarks/check_rates.py"
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


def percent(*hits: NDArray[np.bool_]) -> str:
    return "/".join(f"{100 * np.mean(each):.1f}" for each in hits)


def tests_of_whiteness(u: Array, y: Array, orders: Numbers, objective: str) -> tuple[float, float]:
    """p-value with the fit's own distribution, and with lags - na - nc degrees of freedom."""
    found = estimate(u, y, orders, settings=replace(SEARCH, objective=objective))
    residuals = found.residuals[found.window.loss_start :]
    fitted = orders[0] + orders[2]
    lags = ljung_box_lags(len(residuals), fitted, 1200)
    window = found.window.residual_start, found.window.loss_start
    errors = PolynomialErrors(
        [Segment(u, y)], found.model.orders, objective, 1.0, 1.0, False, ScoringWindow(*window)
    )
    point = np.concatenate([found.model.parameters, found.noise_state])
    jacobian = errors.jacobian(point)[:, : len(found.model.parameters)]
    along = lambda step: (jacobian @ step)[:, None]  # noqa: E731
    effects = fit_effects(residuals[:, None], along, found.model.covariance, lags)
    test = whiteness_test(residuals, lags, (), effects[0], objective)
    return test.p_value, float(chdtrc(lags - fitted, test.statistic))


def whiteness_record(seed: int, noise: float, objective: str) -> tuple[float, float]:
    key = (1, round(100 * noise), objective == "absolute")
    generator = np.random.default_rng(np.random.SeedSequence(seed, spawn_key=key))
    return tests_of_whiteness(*signals(generator, 2000, False, noise), (4, 4, 3, 1), objective)


def arm_record(seed: int, orders: Numbers) -> tuple[float, float]:
    recording, _ = flexible_arm(seed=seed, samples=5000)
    # The transforms of the chapter's case, which are the built-in ones.
    data = prepare(recording, PreparationSettings()).estimation
    return tests_of_whiteness(data.input, data.output, orders, "absolute")


def whiteness(pool: Executor, records: int) -> None:
    def rejected(run: Callable[[int], tuple[float, float]], count: int) -> str:
        p = np.array(list(pool.map(run, range(1, count + 1), chunksize=4)))
        return percent(p[:, 0] < 0.05, p[:, 1] < 0.05)

    noises = (0.05, 1.0, 20.0)
    rows = [
        [
            f"ARMAX(4,4,3,1), {objective}",
            *(
                rejected(partial(whiteness_record, noise=noise, objective=objective), records)
                for noise in noises
            ),
        ]
        for objective in ("quadratic", "absolute")
    ]
    arms = [
        rejected(partial(arm_record, orders=orders), records // 2)
        for orders in ((8, 8, 7, 3), (8, 10, 10, 3))
    ]
    write_section(
        "checks",
        "White residuals",
        "Records rejected at 5 % at the true orders, by noise / response: by the weighted "
        "chi-square distribution of the fit, which the check uses, and by the one\nwith lags − na "
        "− nc degrees of freedom. 2000 samples. Of the simulated arm at (8,8,7,3) and (8,10,10,3): "
        f"{arms[0]} and {arms[1]}.",
        COMMAND,
        ("truth, objective", *(f"{noise:g}" for noise in noises)),
        rows,
    )


def input_record(
    seed: int, orders: Numbers | None, samples: int, coloured: bool, noise: float
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
    held_out = divided(model, Recording(u, y, 1.0), cut)
    statistic = float(model.B[0] @ np.linalg.pinv(of_b.matrix) @ model.B[0])
    return input_significance(held_out).p_value, float(chdtrc(len(model.B[0]), statistic))


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


def significance(pool: Executor, records: int) -> None:
    def passed(orders: Numbers | None, samples: int, noise: float, count: int) -> NDArray[np.bool_]:
        """Whether a record passes on the held-out samples, and in the Wald test."""
        run = partial(input_record, orders=orders, samples=samples, coloured=False, noise=noise)
        p = np.array(list(pool.map(run, range(count), chunksize=4)))
        return p[~np.isnan(p[:, 0])] < 0.01

    lengths, noises = (1000, 4000), (3.0, 6.0, 12.0, 25.0)
    unrelated = ((6, 6, 6, 1), (8, 8, 8, 1), (6, 2, 2, 1), (2, 6, 1, 1))
    related = ((4, 4, 3, 1), (8, 8, 8, 1))
    rows = []
    for orders in (*related[:1], *unrelated):
        false = [passed(orders, n, np.inf, records).T for n in lengths if orders in unrelated]
        power = [passed(orders, 1000, each, records)[:, 0] for each in noises if orders in related]
        rows.append(
            [
                str(orders).replace(", ", ","),
                *([percent(*each) for each in false] or ["–"] * len(lengths)),
                *([percent(each) for each in power] or ["–"] * len(noises)),
            ]
        )
        print(rows[-1], flush=True)
    by_bic = percent(*passed(None, lengths[0], np.inf, records).T)
    found = percent(passed(None, lengths[0], noises[0], records // 2)[:, 0])
    rows.append(["selected by BIC", by_bic, "–", found, "–", "–", "–"])
    write_section(
        "checks",
        "Significance of the input",
        "Passes at 1 % with a white input. Unrelated to the output, an ARMA(4,3), by the number of "
        "samples: on the held-out samples, which the check uses/in the\nWald test of B = 0. Power: "
        "ARMAX(4,4,3,1), 1000 samples, by noise / response.",
        COMMAND,
        ("orders", *map(str, lengths), "power: 3", "6", "12", "25"),
        rows,
    )


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
    recording = Recording(u, y, 100.0)
    table = table_of_models(
        [OrderModel.of(order, 0.0, model)], order, lambda each: divided(each, recording, cut)
    )
    found = []
    for evidence in table.modes:
        near = np.abs(true - evidence.mode.frequency_hz) < 1.0
        driven = ("input", "noise")
        kind = driven[int(np.argmax(near))] if near.any() else "neither"
        if evidence.mode.damping_ratio > 0.15:
            kind = "neither"
        found.append((kind, evidence.origin))
    return found


def modes(pool: Executor, records: int) -> None:
    origins = ("input", "noise", "neither")
    rows = []
    for order in (4, 8, 12):
        for samples, noise in ((1000, 0.3), (4000, 3.0)):
            run = partial(mode_record, samples=samples, noise=noise, order=order)
            found = [
                pair for part in pool.map(run, range(records // 2), chunksize=4) for pair in part
            ]
            judged = [np.array([o for true, o in found if true == kind]) for kind in origins]
            cells = [percent(*(o == kind for kind in origins)) if len(o) else "–" for o in judged]
            rows.append([str(order), f"{samples}, {noise:g}", *cells])
            print(rows[-1], flush=True)
    write_section(
        "checks",
        "Origin of modes",
        "One mode driven by the input and one by the noise; all other poles of the model are "
        "superfluous. How modes of each origin are judged:\ninput/noise/neither.",
        COMMAND,
        ("order", "samples, noise / response", "of the input", "of the noise", "superfluous"),
        rows,
    )


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


STEADY = (
    "white noise",
    "coloured noise",
    "narrow-band noise",
    "PRBS, held 5 samples",
    "two sines",
    "multisine, 60 lines",
    "six sweeps",
)


def not_comparable(pool: Executor, records: int, kind: str) -> int:
    """How many records of an input have parts that are called not comparable."""
    return sum(pool.map(partial(split_record, kind=kind), range(records)))


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
    end = refine_delay(start, 4380, 2, fit)
    return start.model.orders.single.nk, end.model.orders


def others(pool: Executor, records: int) -> None:
    steady = max(not_comparable(pool, records, kind) for kind in STEADY)
    sweep = not_comparable(pool, records, "one noisy sweep, cut in time")
    count = min(records, 60)
    found = list(pool.map(delay_record, range(1, count + 1), chunksize=2))
    right = 100 * np.mean([nk == 3 for nk, _ in found])
    exact = 100 * np.mean([orders == armax_orders(7, 6, 7, 3) for _, orders in found])
    write_section(
        "checks",
        "Other statistics",
        "In percent, but for the first two.",
        COMMAND,
        ("statistic", "rate"),
        [
            (
                "spectra of the two parts of a split not comparable, at most, of seven stationary "
                "inputs",
                f"{steady} of {records}",
            ),
            ("the same, one sweep cut in time", f"{sweep} of {records}"),
            (f"delay by BIC, models (7,7,7,nk) of ARMAX(7,6,7,3), {count} records", f"{right:.0f}"),
            ("all orders exact after its refinement", f"{exact:.0f}"),
        ],
    )


SECTIONS: dict[str, Callable[[Executor, int], None]] = {
    "whiteness": whiteness,
    "significance": significance,
    "modes": modes,
    "others": others,
}


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--records", type=int, default=100)
    parser.add_argument("--processes", type=int, default=2)
    parser.add_argument("--only", nargs="*", choices=SECTIONS, default=list(SECTIONS))
    arguments = parser.parse_args()
    with ProcessPoolExecutor(arguments.processes) as pool:
        for name in arguments.only:
            SECTIONS[name](pool, arguments.records)


if __name__ == "__main__":
    main()
