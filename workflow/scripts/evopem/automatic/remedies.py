"""Acting on residuals and roots: each failed check has its remedy, each trial is recorded."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from evopem.automatic.fit import FitSettings, fit, log_loss, plant_covariance
from evopem.automatic.orders import Candidate, Scorer
from evopem.automatic.residuals import input_correlation, whiteness_probability
from evopem.automatic.simulation import simulated
from evopem.automatic.structures import Choice, Level
from evopem.config.structures import ORDER_NAMES
from evopem.models.polynomials import roots
from evopem.models.structures import PolynomialOrders
from evopem.signals.stretches import Stretch, total_samples
from evopem.validation.checks.roots import (
    COINCIDENT_DISTANCE,
    MAX_CANCELLATION_DISTANCE,
    indistinguishable,
)

# Probability below which residuals are not white, and a cross-correlation, in its 95 % bounds, that
# is not passed by chance in one of 26 lags (1 %).
NOT_WHITE, CORRELATED = 0.01, 1.8
# Poles and zeros that are left out where some cancel.
FEWER_ROOTS = (1, 2, 3, 4, 6, 8)
# A remedy is taken only if the error for the purpose grows by no more than this share.
TOLERATED = 0.02
DELAY = "delay"
NOISE_ORDERS = (1, 2, 3, 4, 6, 8, 10, 12)
MOST_TRIALS = 12


@dataclass(frozen=True)
class Trial:
    """One remedy that was tried.

    Attributes
    ----------
    check : str
        The check that failed before.
    remedy : str
    model : str
        Name of the candidate.
    score : float
        Error for the purpose on held-out samples, percent.
    whiteness : float
        Probability of residuals as coloured as these by chance.
    correlation : float
        Largest cross-correlation of residuals and past inputs, in its 95 % bounds.
    taken : bool
    """

    check: str
    remedy: str
    model: str
    score: float
    whiteness: float
    correlation: float
    taken: bool


@dataclass(frozen=True)
class Remedied:
    """The choice after all remedies, what was tried, and what stays failed.

    Attributes
    ----------
    choice : Choice
    trials : tuple of Trial
    failed : tuple of str
    plant_kept : bool
        Whether the noise model was fitted to the errors of simulation of a plant that stays as it
        was estimated without one.
    """

    choice: Choice
    trials: tuple[Trial, ...]
    failed: tuple[str, ...]
    plant_kept: bool = False


def act_on_checks(scorer: Scorer, choice: Choice) -> Remedied:
    """Apply remedies until the checks hold, nothing helps, or the budget ends.

    Coloured residuals: a noise model of growing order.  Residuals that depend on past inputs: more
    coefficients of B.  Cancelling roots: one pole and one zero less.  First coefficients of B that
    are not significant: a longer delay.

    Parameters
    ----------
    scorer : Scorer
    choice : Choice
    """
    trials: list[Trial] = []
    current = choice.candidate
    scorer.remember([current])
    first, first_score = current, _score(current, choice)
    budget, own_noise_model, plant_kept = MOST_TRIALS, False, False
    for check, is_failed, remedies in (
        ("cancelling roots", _cancels, _fewer_roots),
        (DELAY, _responds_later, _later),
        ("white residuals", _is_coloured, _further_noise),
        ("residuals independent of the input", _depends_on_input, _longer_b),
    ):
        if not is_failed(scorer, current):
            continue
        best = current
        for remedy, structure, orders in remedies(current):
            if budget == 0:
                break
            budget -= 1
            candidate = scorer.candidate(structure, orders, [best.model, current.model])
            if candidate is None:
                continue
            holds = not is_failed(scorer, candidate)
            allowed = _score(candidate, choice) <= (1.0 + TOLERATED) * first_score
            if choice.purpose == "simulation":
                allowed &= candidate.simulation_bic <= first.simulation_bic + TOLERATED
            better = _better(scorer, candidate, best, check)
            taken = bool(allowed and (holds or better))
            trials.append(
                Trial(
                    check,
                    remedy,
                    candidate.name,
                    _score(candidate, choice),
                    whiteness_probability(candidate.model, scorer.stretches),
                    input_correlation(candidate.model, scorer.stretches),
                    taken,
                )
            )
            if taken:
                best = candidate
            if taken and holds:
                break
        if check == "white residuals" and is_failed(scorer, best) and first.orders.nf:
            # The plant's last fit comes first: it is not changed afterwards.
            plant = scorer.on_all_samples(best)
            best = _with_own_noise_model(scorer, plant, trials)
            own_noise_model, plant_kept = True, best is not plant
        elif best is not current:
            plant_kept = False
        current = best
    failed = tuple(
        check
        for check, is_failed in (
            ("cancelling roots", _cancels),
            ("white residuals", _is_coloured),
            ("residuals independent of the input", _depends_on_input),
        )
        if is_failed(scorer, current)
    )
    if not own_noise_model:
        current = scorer.on_all_samples(current)
    return Remedied(replace(choice, candidate=current), tuple(trials), failed, plant_kept)


def _with_own_noise_model(scorer: Scorer, candidate: Candidate, trials: list[Trial]) -> Candidate:
    """The same plant with a noise model that is fitted to its errors of simulation.

    Simulations stay as they are, predictions gain.  The best of several orders by BIC.
    """
    level = candidate.model.level
    errors = [
        Stretch(
            np.zeros(each.samples), each.output - simulated(candidate.model, each), each.recording
        )
        for each in scorer.stretches
    ]
    best, count = candidate, total_samples(errors)
    for n in NOISE_ORDERS:
        orders = PolynomialOrders(na=n, nc=n)
        if candidate.parameters + orders.parameters > scorer.most_parameters:
            break
        try:
            noise = fit(errors, orders, FitSettings(scorer.settings.objective, level=False))
        except (ValueError, np.linalg.LinAlgError):
            continue
        parameters = candidate.orders.nb + candidate.orders.nf + orders.parameters + 1
        loss = log_loss(noise.residuals_from(), scorer.settings.objective)
        model = replace(
            candidate.model,
            c=noise.model.c,
            d=noise.model.a,
            level=level,
            noise_variance=noise.model.noise_variance,
            structure="bj",
        )
        if not scorer.limits.allow("bj", model.orders):
            continue
        found = replace(
            candidate,
            structure="bj",
            orders=model.orders,
            parameters=parameters,
            bic=float(loss + parameters * np.log(count) / count),
            model=model,
        )
        white = whiteness_probability(model, scorer.stretches)
        taken = bool(found.bic < best.bic)
        trials.append(
            Trial(
                "white residuals",
                f"noise model of order {n} for the errors of simulation, plant kept",
                found.name,
                candidate.scores.simulation,
                white,
                input_correlation(model, scorer.stretches),
                taken,
            )
        )
        if taken:
            best = found
        if white >= NOT_WHITE:
            break
    return best


def _score(candidate: Candidate, choice: Choice) -> float:
    if choice.purpose == "prediction":
        return candidate.scores.prediction
    level: Level = choice.level
    return candidate.scores.free_level if level == "state" else candidate.scores.simulation


def _better(scorer: Scorer, candidate: Candidate, best: Candidate, check: str) -> bool:
    if check == "white residuals":
        return candidate.bic < best.bic
    if check == "cancelling roots":
        return True
    if check == DELAY:
        return candidate.bic < best.bic
    new = input_correlation(candidate.model, scorer.stretches)
    return new < 0.9 * input_correlation(best.model, scorer.stretches)


def _is_coloured(scorer: Scorer, candidate: Candidate) -> bool:
    return whiteness_probability(candidate.model, scorer.stretches) < NOT_WHITE


def _depends_on_input(scorer: Scorer, candidate: Candidate) -> bool:
    return input_correlation(candidate.model, scorer.stretches) > CORRELATED


def _cancels(scorer: Scorer, candidate: Candidate) -> bool:
    """Whether a pole and a zero do not differ significantly, as the check of the report has it."""
    model = candidate.model
    denominator = model.f if model.orders.nf else model.a
    poles, zeros = _upper(roots(denominator[1:])), _upper(model.zeros())
    pairs = [(p, z) for p in poles for z in zeros if abs(p - z) < MAX_CANCELLATION_DISTANCE]
    if not pairs:
        return False
    covariance = plant_covariance(model, scorer.stretches, scorer.settings)
    if covariance is None:
        return any(abs(p - z) < COINCIDENT_DISTANCE for p, z in pairs)
    return any(indistinguishable(p, z, denominator, model.b, covariance) for p, z in pairs)


def _responds_later(scorer: Scorer, candidate: Candidate) -> bool:
    """Whether the first coefficient of B does not differ from 0 by two standard errors."""
    model = candidate.model
    if model.orders.nb < 2:
        return False
    covariance = plant_covariance(model, scorer.stretches, scorer.settings)
    if covariance is None:
        return False
    gradient = np.zeros((1, covariance.factor.shape[0]))
    gradient[0, model.orders.nf or model.orders.na] = 1.0
    spread = float(covariance.standard_errors(gradient)[0])
    return bool(abs(model.b[0]) < 2.0 * spread)


def _later(candidate: Candidate) -> Iterator[tuple[str, str, PolynomialOrders]]:
    o = candidate.orders
    for more in (1, 2, 3):
        if o.nb > more:
            changed = {"nk": o.nk + more, "nb": o.nb - more}
            yield f"delay of {o.nk + more}", candidate.structure, _changed(o, **changed)


def _upper(all_roots: NDArray[np.complex128]) -> list[complex]:
    return [complex(root) for root in all_roots if root.imag >= 0.0]


def _fewer_roots(candidate: Candidate) -> Iterator[tuple[str, str, PolynomialOrders]]:
    o = candidate.orders
    name = "nf" if o.nf else "na"
    for fewer in FEWER_ROOTS:
        if getattr(o, name) > fewer and o.nb > fewer:
            changed = {name: getattr(o, name) - fewer, "nb": o.nb - fewer}
            yield f"{fewer} pole and zero less", candidate.structure, _changed(o, **changed)


def _further_noise(candidate: Candidate) -> Iterator[tuple[str, str, PolynomialOrders]]:
    o = candidate.orders
    for n in NOISE_ORDERS:
        if o.nf and n > min(o.nc, o.nd):
            yield f"noise model of order {n}", "bj", _changed(o, nc=n, nd=n)
        elif o.na and n > o.nc:
            structure = "ararmax" if o.nd else "armax"
            yield f"C of order {n}", structure, _changed(o, nc=n)
        elif not o.na and not o.nf:
            yield f"A and C of order {n}", "armax", _changed(o, na=n, nc=n)


def _longer_b(candidate: Candidate) -> Iterator[tuple[str, str, PolynomialOrders]]:
    o = candidate.orders
    for more in (1, 2, 4, 8):
        yield f"{more} coefficients of B more", candidate.structure, _changed(o, nb=o.nb + more)


def _changed(orders: PolynomialOrders, **changes: int) -> PolynomialOrders:
    """Other orders, of the smallest structure that has them."""
    given = {name: getattr(orders, name) for name in ORDER_NAMES}
    return PolynomialOrders(**(given | changes))
