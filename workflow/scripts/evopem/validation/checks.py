"""Checks on a fitted model, each passed, failed or not judged, in words.

A check passes on evidence only. Where a number it needs is missing, ``passed`` is None and the
statement says what is missing.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from evopem.models.polynomials import root_gradient
from evopem.models.root_covariance import CHI_SQUARE_95, parameter_covariance
from evopem.signals.spectral.peaks import line_spacing

# Joint tests are made at the 1 % level: the checks at 5 % each would fail a third of good models.
SIGNIFICANCE = 0.01
# Cross-correlations at neighbouring lags move together when the input is coloured, so their share
# inside scatters more than a binomial one.
CROSS_CORRELATION_SHARE = 0.90
# A pole and a zero further apart than this do not cancel, however uncertain they are.
NEAR = 0.1
# Without uncertainties only a pair this close is called a cancellation.
COINCIDENT = 0.01
# Percentage of residuals far out that mean nothing, and that an absolute objective bears.
FEW_OUTLIERS = 0.1
BEARABLE_OUTLIERS = 5.0
# Percentage of a channel at its limits from which on it counts as cut off.
SATURATED = 0.1
COMPLETE_MODEL = "Run the stage that completes the model again."
SEARCH_AGAIN = "Run the order search again: these results were made without that record."


@dataclass(frozen=True)
class Check:
    """One check: ``passed`` is True, False, or None when it could not be judged."""

    name: str
    passed: bool | None
    statement: str
    advice: str = ""


def checks(
    model: Mapping[str, Any],
    validation: Mapping[str, Any] | None = None,
    spectrum: Mapping[str, Any] | None = None,
    candidates: pd.DataFrame | None = None,
    recording: Mapping[str, Any] | None = None,
) -> list[Check]:
    """Judge a fitted model on all the evidence there is.

    Parameters
    ----------
    model : mapping
        As in ``model.json``: ``orders``, ``a``, ``b``, ``c``, ``modes``, for uncertainties
        ``covariance``, and ``search`` with what was found.
    validation : mapping, optional
        As in ``validation.json``.
    spectrum : mapping, optional
        As in ``spectrum.json``: the peaks of the output's spectrum and its resolution.
    candidates : pandas.DataFrame, optional
        As in ``candidates.csv``: every candidate of every phase with its ``selected`` flag.
    recording : mapping, optional
        As in ``recording.json``: how much of each channel was saturated.

    Returns
    -------
    list of Check
        Stable; invertible; white residuals; residuals independent of the input; every spectral
        peak modelled; poles and zeros distinct; orders inside their search ranges; roots off the
        search's margin; search repeatable; excitation adequate; input felt in the output; few
        residual outliers; record not saturated.
    """
    return [
        stability(model),
        invertibility(model),
        whiteness(validation),
        input_independence(validation),
        spectral_peaks_modelled(model, spectrum),
        no_cancellation(model),
        inside_search_ranges(candidates),
        roots_off_margin(model),
        search_repeatable(model),
        excitation(validation),
        input_felt(model),
        residuals_without_outliers(model, validation),
        record_not_saturated(recording),
    ]


def stability(model: Mapping[str, Any]) -> Check:
    """All roots of A inside the unit circle."""
    return _roots_inside(
        "Stable",
        "A",
        "pole",
        model.get("a"),
        "Do not simulate with this model; estimate again with a smaller largest root radius.",
    )


def invertibility(model: Mapping[str, Any]) -> Check:
    """All roots of C inside the unit circle."""
    return _roots_inside(
        "Invertible",
        "C",
        "root",
        model.get("c"),
        "Its predictor diverges; estimate again with a smaller largest root radius or nc.",
    )


def _roots_inside(
    name: str, polynomial: str, noun: str, coefficients: Sequence[float] | None, advice: str
) -> Check:
    if coefficients is None or not np.all(np.isfinite(np.asarray(coefficients, dtype=float))):
        return Check(
            name,
            None,
            f"The coefficients of {polynomial} are missing or not finite.",
            COMPLETE_MODEL,
        )
    radii = np.abs(np.roots(np.asarray(coefficients, dtype=float)))
    if radii.size == 0:
        return Check(name, True, f"{polynomial} is 1: it has no root that could leave the circle.")
    largest = float(radii.max())
    passed = largest < 1.0
    where = "inside" if passed else "not inside"
    return Check(
        name,
        passed,
        f"The largest {noun} radius of {polynomial} is {largest:.5f}, {where} the unit circle.",
        "" if passed else advice,
    )


def whiteness(validation: Mapping[str, Any] | None) -> Check:
    """Residual autocorrelations jointly and one by one as small as those of white noise."""
    name = "White residuals"
    share = _number(validation, "autocorrelation_share_inside95")
    p_value = _number(validation, "ljung_box", "p_value")
    lags = _number(validation, "lags")
    tested = _number(validation, "ljung_box", "lags")
    if share is None or p_value is None or lags is None or tested is None:
        return Check(
            name,
            None,
            "The residual autocorrelation or its Ljung-Box test is missing"
            " (too few residuals for the number of parameters, or no validation).",
            "Give a longer record or fewer parameters.",
        )
    # Nearly independent lags: the share is binomial, here with three standard deviations.
    least = 0.95 - 3.0 * math.sqrt(0.95 * 0.05 / lags)
    passed = p_value >= SIGNIFICANCE and share >= least
    statement = (
        f"{100 * share:.1f} % of {lags:.0f} autocorrelations lie inside the 95 % bounds; the"
        f" Ljung-Box test over {tested:.0f} lags gives {p_text(p_value)}."
    )
    return Check(
        name,
        passed,
        statement,
        ""
        if passed
        else "The noise model misses something: raise nc or the common order, or look for trends,"
        " mains hum or nonlinearity in the record.",
    )


def input_independence(validation: Mapping[str, Any] | None) -> Check:
    """No residual-input cross-correlation beyond what chance allows over all lags."""
    name = "Residuals independent of the input"
    share = _number(validation, "cross_correlation", "share_inside95")
    largest = _number(validation, "cross_correlation", "max_in_bounds")
    lags = _number(validation, "cross_correlation", "lags")
    if share is None or largest is None or lags is None:
        return Check(
            name,
            None,
            "The residual-input cross-correlation is missing.",
            "Give a longer record or fewer parameters, and run the validation again.",
        )
    from scipy.special import ndtri

    count = int(2 * lags + 1)
    # Bonferroni holds whatever the dependence between lags.
    allowed = float(ndtri(1 - SIGNIFICANCE / (2 * count)) / ndtri(0.975))
    passed = largest <= allowed and share >= CROSS_CORRELATION_SHARE
    statement = (
        f"{100 * share:.1f} % of {count} cross-correlations (lags −{lags:.0f} to {lags:.0f}) lie"
        f" inside their 95 % bounds; the largest is {largest:.2f} times its bound, and chance"
        f" allows {allowed:.2f} among so many."
    )
    return Check(
        name,
        passed,
        statement,
        ""
        if passed
        else "Outliers at positive lags: raise nb or the common order, or try another delay."
        " At negative lags: the data hold feedback from output to input.",
    )


def spectral_peaks_modelled(model: Mapping[str, Any], spectrum: Mapping[str, Any] | None) -> Check:
    """Every peak of the output's spectrum has a mode of the model near it."""
    name = "Every spectral peak modelled"
    if spectrum is None or spectrum.get("peaks") is None:
        return Check(
            name,
            None,
            "The output's spectrum and its peaks are missing.",
            "Run the stage that estimates the spectrum again.",
        )
    modes = model.get("modes")
    if modes is None:
        return Check(name, None, "The model's modes are missing.", COMPLETE_MODEL)
    peaks = spectrum["peaks"]
    if not peaks:
        return Check(name, True, "The output's spectrum has no distinct peak to be missed.")
    spacing = line_spacing([float(peak["frequency_hz"]) for peak in peaks])
    if spacing is not None:
        return Check(
            name,
            None,
            f"The spectrum has {len(peaks)} peaks about {spacing:.3g} Hz apart: the lines of a"
            " periodic input, among which resonances do not stand out as peaks.",
            "Compare the gain of the model with the multitaper estimate at the lines.",
        )
    resolution = float(spectrum.get("resolution_hz") or 0.0)
    missed = [
        float(peak["frequency_hz"])
        for peak in peaks
        if not any(_explains(mode, float(peak["frequency_hz"]), resolution) for mode in modes)
    ]
    found = len(peaks) - len(missed)
    if not missed:
        return Check(
            name,
            True,
            f"Each of the {len(peaks)} spectral peaks has a mode within the spectrum's resolution"
            f" ({resolution:.2g} Hz) or the mode's own bandwidth and uncertainty.",
        )
    listed = ", ".join(f"{frequency:.4g} Hz" for frequency in missed[:6])
    if len(missed) > 6:
        listed += f" and {len(missed) - 6} more"
    return Check(
        name,
        False,
        f"{found} of {len(peaks)} spectral peaks have a mode; none is near {listed}.",
        "Raise the upper bound of the common order, or check whether the peak is already in the"
        " input or made by a transform.",
    )


def _explains(mode: Mapping[str, Any], frequency: float, resolution: float) -> bool:
    """Whether a peak lies within a mode's reach: resolution, half-power width or uncertainty.

    A mode damped beyond 1/√2 has no resonance and explains no peak, and no mode's reach goes beyond
    a tenth of its frequency: a broad or uncertain one must not pass for every peak.
    """
    centre = float(mode["frequency_hz"])
    damping = abs(float(mode.get("damping_percent") or 0.0)) / 100.0
    if damping > math.sqrt(0.5):
        return False
    error = float(mode.get("frequency_se_hz") or 0.0)
    own = min(max(damping * centre, 2.0 * error), 0.1 * centre)
    return abs(centre - frequency) <= max(resolution, own)


def no_cancellation(model: Mapping[str, Any]) -> Check:
    """No pole of G that a zero of G hides, judged by their joint uncertainty."""
    name = "Poles and zeros distinct"
    if model.get("a") is None or model.get("b") is None:
        return Check(name, None, "The coefficients of A or B are missing.", COMPLETE_MODEL)
    a, b = np.asarray(model["a"], dtype=float), np.asarray(model["b"], dtype=float)
    poles, zeros = np.roots(a), np.roots(b)
    if poles.size == 0 or zeros.size == 0:
        return Check(name, True, "The model has no pair of a pole and a zero.")
    covariance = parameter_covariance(model.get("covariance"), a.size - 1 + b.size)
    pairs = [
        (abs(pole - zero), complex(pole), complex(zero))
        for pole in poles
        for zero in zeros
        if pole.imag >= 0 and zero.imag >= 0
    ]
    distance, pole, zero = min(pairs, key=lambda pair: pair[0])
    nearest = f"The nearest pair, pole {_complex(pole)} and zero {_complex(zero)}, is"
    advice = (
        "The pair hardly affects the response: lower na and nb by one (a real pair) or two"
        " (a complex pair) and compare BIC."
    )
    if covariance is None:
        if distance < COINCIDENT:
            return Check(name, False, f"{nearest} only {distance:.2g} apart.", advice)
        return Check(
            name,
            None,
            f"{nearest} {distance:.2g} apart; without a parameter covariance this cannot be"
            " compared with its uncertainty.",
            "The covariance of an over-large model is not determined: lower the orders, or give a"
            " longer record.",
        )
    hidden = [
        (pole, zero)
        for distance, pole, zero in pairs
        if distance < NEAR and _indistinguishable(pole, zero, a, b, covariance)
    ]
    if hidden:
        listed = "; ".join(f"{_complex(pole)} and {_complex(zero)}" for pole, zero in hidden)
        return Check(
            name, False, f"A pole and a zero cannot be told apart at 95 %: {listed}.", advice
        )
    return Check(
        name,
        True,
        f"{nearest} {distance:.2g} apart; no pair closer than {NEAR:g} is within its joint 95 %"
        " uncertainty.",
    )


def _indistinguishable(
    pole: complex,
    zero: complex,
    a: NDArray[np.float64],
    b: NDArray[np.float64],
    covariance: NDArray[np.float64],
) -> bool:
    """Whether pole minus zero is inside its 95 % confidence region around nothing."""
    with np.errstate(divide="ignore", invalid="ignore"):
        gradient = np.concatenate([root_gradient(a, pole)[1:], -root_gradient(b, zero)])
    if not np.all(np.isfinite(gradient)):
        return True  # a repeated root: its position is not determined to first order
    difference = pole - zero
    if pole.imag == 0 and zero.imag == 0:
        jacobian = gradient.real[np.newaxis]
        offset = np.array([difference.real])
    else:
        jacobian = np.vstack([gradient.real, gradient.imag])
        offset = np.array([difference.real, difference.imag])
    spread = jacobian @ covariance @ jacobian.T
    statistic = float(offset @ np.linalg.pinv(spread, hermitian=True) @ offset)
    return statistic < CHI_SQUARE_95[offset.size]


# Phase of the search, the column it varies, its name in words, the smallest value there is.
RANGES = (
    ("delay", "nk", "delay nk", 0),
    ("common", "na", "common order", 1),
    ("c", "nc", "nc", 0),
    ("b", "nb", "nb", 1),
)


def inside_search_ranges(candidates: pd.DataFrame | None) -> Check:
    """No chosen order at an end of the range that was searched."""
    name = "Orders inside their search ranges"
    if candidates is None or candidates.empty:
        return Check(
            name,
            None,
            "The table of candidates is missing.",
            "Run the stage that tabulates the candidates again.",
        )
    at_edge, inside, fixed, unknown = [], [], [], []
    for phase, column, words, least in RANGES:
        tried = candidates[candidates["phase"] == phase]
        chosen = tried[tried["selected"].astype(bool)]
        if tried.empty or chosen.empty:
            unknown.append(words)
            continue
        low, high = int(tried[column].min()), int(tried[column].max())
        value = int(chosen[column].iloc[0])
        if low == high:
            fixed.append(words)
        elif value == high or (value == low and value > least):
            at_edge.append(f"{words} = {value} in {low}–{high}")
        else:
            inside.append(f"{words} = {value} in {low}–{high}")
    if at_edge:
        return Check(
            name,
            False,
            f"At the edge: {'; '.join(at_edge)}.",
            "Widen that range in the configuration and run again: a better model may lie outside.",
        )
    if unknown:
        return Check(
            name,
            None,
            f"No choice is on record for: {', '.join(unknown)}.",
            "Run the order search again.",
        )
    if not inside:
        return Check(
            name,
            None,
            "Every order was fixed by the configuration; none was searched.",
            "Give at least one order a range, if these orders are not known for certain.",
        )
    remark = f" Fixed by the configuration: {', '.join(fixed)}." if fixed else ""
    return Check(name, True, f"Inside: {'; '.join(inside)}.{remark}")


def roots_off_margin(model: Mapping[str, Any]) -> Check:
    """No root that the limit of the search, and not the data, has put where it is."""
    name = "Roots off the search's margin"
    at_margin = _found(model).get("at_margin")
    if not isinstance(at_margin, bool):
        return Check(
            name, None, "Whether a root lies at the search's margin is not on record.", SEARCH_AGAIN
        )
    limit = _number(model, "search", "settings", "max_root_radius")
    margin = "the largest root radius that the search allows" + (f", {limit:g}" if limit else "")
    if not at_margin:
        return Check(name, True, f"No root of A or C lies at {margin}.")
    return Check(
        name,
        False,
        f"A root of A or C lies at {margin}: this limit and not the data keeps it there.",
        "A root of C there is what differencing too often leaves: lower “difference”. A pole there"
        " is a drift or hardly any damping: remove the drift, or raise “max_root_radius” towards 1."
        " With a short record, lower the orders.",
    )


def search_repeatable(model: Mapping[str, Any]) -> Check:
    """Another population, drawn independently, ended at the optimum that was chosen."""
    name = "Search repeatable"
    populations = _number(model, "search", "found", "populations")
    agreement = _number(model, "search", "found", "agreement")
    if populations is None or agreement is None:
        return Check(
            name, None, "How many populations agreed on the optimum is not on record.", SEARCH_AGAIN
        )
    more = "Raise “evaluations” of the search, and compare the results of another “seed”."
    others = int(populations) - 1
    if others < 1:
        return Check(
            name,
            None,
            "The evaluations were spent on one population: no independent one was there to confirm"
            " its optimum.",
            more,
        )
    agreed = round(agreement * others)
    statement = (
        f"{agreed} of {others} further {'population' if others == 1 else 'populations'}, drawn"
        " independently, ended at the same optimum."
    )
    return Check(name, agreed > 0, statement, "" if agreed else more)


def _found(model: Mapping[str, Any]) -> Mapping[str, Any]:
    """What the search of the chosen model found, as far as it is on record."""
    search = model.get("search")
    found = search.get("found") if isinstance(search, Mapping) else None
    return found if isinstance(found, Mapping) else {}


def excitation(validation: Mapping[str, Any] | None) -> Check:
    """The input moves as many directions of its past as the model has to resolve."""
    name = "Excitation adequate"
    order = _number(validation, "excitation", "order")
    needed = _number(validation, "excitation", "needed")
    if order is None or needed is None:
        return Check(
            name,
            None,
            "The input's order of excitation is missing.",
            "Run the validation again.",
        )
    passed = order >= needed
    statement = (
        f"The input excites {order:.0f} of the {needed:.0f} directions (na + nb) that the model"
        " needs, counting those no more than 40 dB below the strongest."
    )
    return Check(
        name,
        passed,
        statement,
        ""
        if passed
        else "Trust the model only where the input has power; record with a broader input or"
        " resample to a lower rate.",
    )


def input_felt(model: Mapping[str, Any]) -> Check:
    """B differs from zero by more than its uncertainty (a Wald test)."""
    name = "Input felt in the output"
    if model.get("a") is None or model.get("b") is None:
        return Check(name, None, "The coefficients of A or B are missing.", COMPLETE_MODEL)
    poles, b = len(model["a"]) - 1, np.asarray(model["b"], dtype=float)
    covariance = parameter_covariance(model.get("covariance"), poles + b.size)
    if covariance is None:
        return Check(
            name,
            None,
            "Without a parameter covariance B cannot be compared with its uncertainty.",
            "Lower the orders, or give a longer record.",
        )
    from scipy.special import chdtrc

    of_b = covariance[poles:, poles:]
    p_value = float(chdtrc(b.size, b @ np.linalg.pinv(of_b, hermitian=True) @ b))
    passed = p_value < SIGNIFICANCE
    return Check(
        name,
        passed,
        f"Were there no response to the input, a B as large as this one would come by chance with"
        f" {p_text(p_value)}.",
        ""
        if passed
        else "This is no model of the response to this input: check that the channels belong"
        " together and that their clocks agree, and try longer delays.",
    )


def residuals_without_outliers(
    model: Mapping[str, Any], validation: Mapping[str, Any] | None
) -> Check:
    """Hardly any residual far out, or an objective that bears a few of them."""
    name = "Few residual outliers"
    share = _number(validation, "residual_outlier_percent")
    if share is None:
        return Check(
            name, None, "The share of residual outliers is missing.", "Run the validation again."
        )
    statement = f"{share:.2g} % of the residuals lie beyond five robust standard deviations"
    if share <= FEW_OUTLIERS:
        return Check(name, True, f"{statement}.")
    objective = model.get("objective")
    absolute = isinstance(objective, Mapping) and objective.get("name") == "absolute"
    if absolute and share <= BEARABLE_OUTLIERS:
        return Check(
            name, True, f"{statement}; the absolute objective does not let so few decide the model."
        )
    return Check(
        name,
        False,
        f"{statement}, and they weigh on the model.",
        "Look at them in the record: spikes and drop-outs are to be repaired."
        + ("" if absolute else " The objective “absolute” gives them less weight."),
    )


def record_not_saturated(recording: Mapping[str, Any] | None) -> Check:
    """Neither channel rests at its smallest or largest value, as one that is cut off does."""
    name = "Record not saturated"
    shares = {
        channel: _number(recording, f"{channel}_saturated_percent")
        for channel in ("input", "output")
    }
    if None in shares.values():
        return Check(
            name,
            None,
            "How much of the record is saturated is missing.",
            "Run the reading of the recording again.",
        )
    cut = {channel: share for channel, share in shares.items() if share and share > SATURATED}
    if not cut:
        return Check(name, True, "Neither channel rests at its smallest or largest value.")
    listed = " and ".join(f"{share:.2g} % of the {channel}" for channel, share in cut.items())
    return Check(
        name,
        False,
        f"{listed} rests at its smallest or largest value.",
        "The channel was cut off, which no linear model describes: record again within the range"
        " of the instrument.",
    )


def _number(values: Mapping[str, Any] | None, *keys: str) -> float | None:
    """A finite number from nested mappings, or None."""
    found: Any = values
    for key in keys:
        if not isinstance(found, Mapping) or found.get(key) is None:
            return None
        found = found[key]
    try:
        number = float(found)
    except (TypeError, ValueError):
        return None
    return number if math.isfinite(number) else None


def p_text(value: float) -> str:
    """A p-value in words: "p = 0.42", "p < 0.0001"."""
    return "p < 0.0001" if value < 1e-4 else f"p = {value:.2g}"


def _complex(root: complex) -> str:
    """A root to four decimals, with a true minus sign."""
    if abs(root.imag) < 5e-5:
        return f"{root.real:.4f}".replace("-", "−")
    return f"{root.real:.4f} ± {abs(root.imag):.4f}i".replace("-", "−")
