"""Sentences that read the numbers: computed from the results, one function for each step.

Each function returns paragraphs.
"""

from __future__ import annotations

import math
import re
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import pandas as pd

from evopem.figures.labels import differences
from evopem.figures.pole_zero_map import ellipse_radii, root_spread, roots_in_z, stabilization
from evopem.report.contents import Contents
from evopem.report.mode_table import ModeRow
from evopem.report.numbers import (
    THIN,
    count,
    enumeration,
    fixed,
    is_number,
    number,
    percent,
    plural,
    superscript,
)
from evopem.report.numbers import root as root_text
from evopem.signals.spectral.peaks import line_spacing
from evopem.validation.checks import p_text

PHASE_WORDS = {
    "delay": ("nk", "delay nk"),
    "common": ("na", "common order k = na = nb = nc"),
    "c": ("nc", "order of C, nc"),
    "b": ("nb", "number of B coefficients, nb"),
}
# Sections 5.1 to 5.4 of the chapter, on its own record.
CHAPTER_CHOICES = {
    "Spectral peaks (Hz)": "near 2, 5 and 36, a broad one near 17",
    "Delay nk": "3",
    "Phase one, common order": "7",
    "Phase two, nc": "7",
    "Phase three, nb": "6",
    "Model": "ARMAX(7, 6, 7, 3)",
}
# A pole seen at this many successive orders is called persistent.
PERSISTENT = 3


def hertz(frequency: float) -> str:
    """A frequency with its unit."""
    return f"{number(frequency)}{THIN}Hz"


def orders_text(orders: Mapping[str, Any]) -> str:
    """Orders as ARMAX(na, nb, nc, nk)."""
    return f"ARMAX({orders['na']}, {orders['nb']}, {orders['nc']}, {orders['nk']})"


def record(contents: Contents) -> list[str]:
    """What was recorded and what was made of it."""
    recording, transforms = contents.recording, contents.transforms
    samples, rate = recording.get("samples"), recording.get("sampling_rate")
    sentences = []
    if is_number(samples) and is_number(rate):
        input_name = recording.get("input_name") or "input"
        output_name = recording.get("output_name") or "output"
        names = f"{input_name} (input) and {output_name} (output)"
        if (input_name, output_name) == ("input", "output"):
            names = "one input and one output"
        sentences.append(
            f"The record holds {count(samples)} samples of {names} at {hertz(rate)},"
            f" {number(samples / rate)}{THIN}s in all."
        )
    if is_number(transforms.get("resampled_from")):
        sentences.append(
            f"It was resampled from {hertz(transforms['resampled_from'])} to"
            f" {hertz(transforms['sampling_rate'])}."
        )
    steps = _steps(transforms)
    sentences.append(
        f"The output {enumeration(steps)}." if steps else "The output was not transformed."
    )
    if transforms.get("difference_input"):
        sentences.append(f"The input is its {differences(int(transforms['difference_input']))}.")
    discarded = int(transforms.get("discard") or 0)
    split = f"{plural(transforms.get('estimation_samples', 0), 'sample')} serve for estimation and"
    split += f" {count(transforms.get('validation_samples'))} for validation"
    if transforms.get("validation_source") == "file":
        split += ", which come from a recording of their own"
    else:
        split += ", which follow without a gap"
    lead = f"After the first {count(discarded)} samples were left out, " if discarded else ""
    sentences.append(f"{lead}{split}; the means of the estimation samples are subtracted from all.")
    return [" ".join(sentences)]


def _steps(transforms: Mapping[str, Any]) -> list[str]:
    steps = []
    if is_number(transforms.get("box_cox")):
        if transforms.get("shift"):
            steps.append(f"was shifted by {number(transforms['shift'])} to be positive")
        steps.append(f"was Box-Cox transformed with λ = {number(transforms['box_cox'])}")
    if transforms.get("difference"):
        steps.append(f"was differenced {_times(transforms['difference'])}")
    return steps


def _times(amount: int) -> str:
    return {0: "not at all", 1: "once", 2: "twice"}.get(amount, f"{amount} times")


def transform_effects(transforms: Mapping[str, Any]) -> list[str]:
    """What the transforms do to the model, said wherever they do it."""
    sentences = []
    surplus = int(transforms.get("difference") or 0) - int(transforms.get("difference_input") or 0)
    rate = float(transforms["sampling_rate"])
    if surplus > 0:
        at = rate / 50
        power = "" if surplus == 1 else superscript(surplus)
        sentences.append(
            f"The output was differenced {_times(transforms['difference'])}, the input"
            f" {_times(transforms.get('difference_input') or 0)}. That puts the factor"
            f" (1 − q⁻¹){power} into B: it multiplies the gain by |2 sin(πf/fs)|{power}, which is"
            f" {number(difference_gain(transforms, at), 2)} at {hertz(at)} and {2**surplus} at"
            f" {hertz(rate / 2)}. Part of the high-pass trend of the response is made by this step"
            " and not by the system, and modes at low frequencies are weakened with it, down to"
            " being lost in the noise. Setting “difference_input” to the same number differences"
            " both signals and leaves the response as it is."
        )
    elif surplus < 0:
        sentences.append(
            f"The input was differenced {_times(transforms['difference_input'])}, the output"
            f" {_times(transforms.get('difference') or 0)}: the response shown is that to the"
            " differenced input and holds the corresponding"
            f" {'integrator' if surplus == -1 else 'integrators'}."
        )
    if is_number(transforms.get("box_cox")) and transforms["box_cox"] != 1:
        sentences.append(
            "The Box-Cox transform is not linear: model, errors and simulation refer to the"
            " transformed output, and the modes are those of the system as far as the transform is"
            " near a straight line over the range of the record."
        )
    return sentences


def difference_gain(transforms: Mapping[str, Any], frequency: float) -> float:
    """Factor |2 sin(πf/fs)|^d on the gain, d the output's differences beyond the input's."""
    surplus = int(transforms.get("difference") or 0) - int(transforms.get("difference_input") or 0)
    turn = math.pi * frequency / float(transforms["sampling_rate"])
    return float(abs(2 * math.sin(turn)) ** surplus)


# A record of fewer time constants of a mode is too short for the asymptotic errors of that mode
# (docs/evidence/coverage.md: 87 to 94 % at 1.5 of them, 94 to 96 % at 14).
FEW_TIME_CONSTANTS = 3.0


def _time_constants(mode: Mapping[str, Any], contents: Contents) -> float:
    """How often 1/(ζω) of a mode goes into the estimation samples; infinite where unknown."""
    samples = contents.transforms.get("estimation_samples")
    if not is_number(samples):
        return math.inf
    decay_rate = 2.0 * math.pi * mode["frequency_hz"] * mode["damping_percent"] / 100.0
    return float(decay_rate * samples / contents.model["sampling_rate"])


def modes(contents: Contents, rows: Sequence[ModeRow]) -> list[str]:
    """What the table of modes holds that needs a word."""
    nyquist = float(contents.model["sampling_rate"]) / 2
    sentences = []
    for place, row in enumerate(rows, start=1):
        mode = row.estimate
        if mode is None:
            continue
        damped = float(mode["damping_percent"]) > 50
        if damped or float(mode["frequency_hz"]) > nyquist:
            why = "is damped by more than half" if damped else "lies above half the sampling rate"
            sentences.append(
                f"Mode {place} {why}: a fast-decaying pair of poles that shapes the fit and not a"
                " resonance of the system."
            )
            continue
        lasting = _time_constants(mode, contents)
        if lasting < FEW_TIME_CONSTANTS:
            sentences.append(
                f"The estimation samples last only {number(lasting, 2)} time constants of mode"
                f" {place}: its 95{THIN}% intervals are somewhat too short."
            )
    missed = [row.truth for row in rows if row.estimate is None and row.truth is not None]
    if missed:
        listed = enumeration([hertz(mode["frequency_hz"]) for mode in missed])
        text = (
            f"The true {'mode' if len(missed) == 1 else 'modes'} at {listed}"
            f" {'was' if len(missed) == 1 else 'were'} not found."
        )
        lowest = float(missed[0]["frequency_hz"])
        factor = difference_gain(contents.transforms, lowest)
        if factor < 0.1:
            text += (
                f" At {hertz(lowest)} differencing the output leaves a factor {number(factor, 2)}"
                " of the gain, so little of it was left to find."
            )
        sentences.append(text)
    return [" ".join(sentences)] if sentences else []


def spectrum(contents: Contents) -> list[str]:
    """Peaks of the output's spectrum, and what they ask of the order."""
    summary = contents.spectrum
    sentences = [
        f"Thomson's multitaper estimate with time-halfbandwidth"
        f" {number(summary.get('time_halfbandwidth'))} ({summary.get('tapers')} tapers) and"
        f" transforms of {count(summary.get('nfft'))} points tells lines apart that are"
        f" {hertz(summary.get('resolution_hz') or math.nan)} from each other."
    ]
    peaks = summary.get("peaks") or []
    if not peaks:
        sentences.append("No peak stands out from what noise makes by chance.")
        return [" ".join(sentences)]
    spacing = line_spacing([float(peak["frequency_hz"]) for peak in peaks])
    if spacing is not None:
        sentences.append(
            f"Its {count(len(peaks))} peaks stand about {hertz(spacing)} apart: they are the lines"
            " of a periodic input and say nothing about the number of modes."
        )
        return [" ".join(sentences)]
    places = enumeration([hertz(peak["frequency_hz"]) for peak in peaks])
    heights = enumeration([f"{number(peak['prominence_db'], 2)}{THIN}dB" for peak in peaks])
    sentences.append(
        f"{plural(len(peaks), 'peak')} {'stands' if len(peaks) == 1 else 'stand'} out, at {places},"
        f" {heights} above the valleys beside. Each needs a pair of complex poles, so the order na"
        f" is at least {2 * len(peaks)}."
    )
    return [" ".join(sentences)]


def delay(contents: Contents) -> list[str]:
    """Criteria of the delays beside each other."""
    tried = contents.candidates[contents.candidates["phase"] == "delay"]
    sentences = _choice(contents, "delay")
    chosen = (contents.phases.get("delay", {}).get("selected") or {}).get("nk")
    spread = tried.groupby("nk")["bic"].agg(lambda bic: bic.max() - bic.min())
    if chosen in spread.index and len(spread) > 1:
        others = spread.drop(chosen)
        low, high = number(others.min(), 2), number(others.max(), 2)
        sentences.append(
            f"Over the orders {tried['na'].min()} to {tried['na'].max()} the BIC of nk = {chosen}"
            f" varies by {number(spread[chosen], 2)}, that of the other delays by"
            f" {low if low == high else f'{low} to {high}'}; the chapter takes small deviations"
            " between orders for a sign of the right delay."
        )
    if contents.truth and is_number(contents.truth.get("delay_samples")):
        true, found = contents.truth["delay_samples"], contents.model["orders"]["nk"]
        sentences.append(
            f"The true delay is {plural(true, 'sample')}: "
            + ("found." if true == found else f"missed by {abs(true - found)}.")
        )
    return [" ".join(sentences)]


def phases(contents: Contents) -> list[str]:
    """What each of the three phases chose, and what RSS alone would have chosen."""
    sentences = []
    for phase in ("common", "c", "b"):
        column, words = PHASE_WORDS[phase]
        tried = contents.candidates[contents.candidates["phase"] == phase].dropna(subset=["rss"])
        chosen = contents.phases.get(phase, {}).get("selected")
        if tried.empty or not chosen:
            continue
        own = tried[tried[column] == int(chosen[column])].iloc[0]
        least = tried.loc[tried["rss"].idxmin()]
        text = (
            f"The {words}, from {tried[column].min()} to {tried[column].max()}:"
            f" {int(chosen[column])}, with an RSS of {percent(own['rss'], 4)}"
        )
        if least[column] != own[column]:
            text += f" where the smallest, at {int(least[column])}, is {percent(least['rss'], 4)}"
        sentences.append(" ".join([f"{text}.", *_choice(contents, phase)]))
    sentences.append("RSS has no charge for a coefficient and is there for the eye; BIC decides.")
    if contents.is_stand_in:
        sentences.append(
            "On its own record the chapter chose the common order 7, then nc = 7, then nb = 6."
        )
    return sentences


def beside_chapter(contents: Contents) -> list[tuple[str, str, str]]:
    """Quantity, this run's value and the chapter's, for the data set that stands in for its arm."""
    selected = {
        phase: contents.phases.get(phase, {}).get("selected") or {} for phase in PHASE_WORDS
    }
    peaks = contents.spectrum.get("peaks") or []
    ours = {
        "Spectral peaks (Hz)": ", ".join(number(peak["frequency_hz"], 3) for peak in peaks)
        or "none",
        "Delay nk": str(selected["delay"].get("nk", "–")),
        "Phase one, common order": str(selected["common"].get("na", "–")),
        "Phase two, nc": str(selected["c"].get("nc", "–")),
        "Phase three, nb": str(selected["b"].get("nb", "–")),
        "Model": orders_text(contents.model["orders"]),
    }
    return [(name, value, CHAPTER_CHOICES[name]) for name, value in ours.items()]


def _choice(contents: Contents, phase: str) -> list[str]:
    """The reason on record, as a sentence."""
    reason = str(contents.phases.get(phase, {}).get("reason") or "").strip()
    reason = re.sub(r"(?<![\w-])-(?=\d)", "−", reason)
    return [reason if reason.endswith(".") else f"{reason}."] if reason else []


def poles(contents: Contents) -> list[str]:
    """Where poles and zeros lie."""
    model = contents.model
    rate = float(model["sampling_rate"])
    a, b, c = (np.asarray(model[name], dtype=float) for name in ("a", "b", "c"))
    sentences = []
    radii = np.abs(np.roots(a))
    if radii.size:
        slowest = float(radii.max())
        text = f"The slowest pole has radius {fixed(slowest, 5)}"
        if 0 < slowest < 1:
            text += (
                ": its response decays to 37 % within"
                f" {number(-1 / (rate * math.log(slowest)), 3)}{THIN}s"
            )
        sentences.append(f"{text}.")
    real = int(np.sum(np.abs(np.roots(a).imag) < 1e-12))
    if radii.size:
        sentences.append(
            f"Of {plural(radii.size, 'pole')}, {count(radii.size - real)} form"
            f" {plural((radii.size - real) // 2, 'oscillating mode')} and {count(real)}"
            f" {'is' if real == 1 else 'are'} real."
        )
    outside = int(np.sum(np.abs(np.roots(np.trim_zeros(b, "f"))) > 1))
    if b.size > 1:
        sentences.append(
            f"{plural(outside, 'zero')} of B {'lies' if outside == 1 else 'lie'} outside the unit"
            " circle: the inverse of G is not stable."
            if outside
            else "All zeros of B lie inside the unit circle."
        )
    uncertain = _least_certain(model)
    if uncertain:
        sentences.append(uncertain)
    if c.size > 1:
        sentences.append(
            f"The largest root of C has radius {fixed(float(np.abs(np.roots(c)).max()), 5)}."
        )
    return [" ".join(sentences)]


def _least_certain(model: Mapping[str, Any]) -> str:
    """The pole and the zero with the largest confidence ellipse."""
    found = []
    for polynomial, noun in (("a", "pole"), ("b", "zero")):
        sizes = []
        for root in roots_in_z(np.asarray(model[polynomial], dtype=float)):
            spread = root_spread(model, polynomial, complex(root))
            if spread is not None:
                sizes.append((float(ellipse_radii(complex(root), spread)[-1]), complex(root)))
        if sizes:
            radius, root = max(sizes, key=lambda size: size[0])
            found.append(f"{number(radius, 2)} for the {noun} {root_text(root.real, root.imag)}")
    if not found:
        return "There is no parameter covariance, so no ellipse is drawn."
    return (
        f"The longest half axis of a 95 % ellipse is {enumeration(found)}; an ellipse that is not"
        " seen is smaller than its mark."
    )


def frequency_response(contents: Contents) -> list[str]:
    """Where the gain is largest, and its trend."""
    model = contents.model
    rate = float(model["sampling_rate"])
    frequency = np.linspace(0, rate / 2, 8193)[1:]
    z = np.exp(-2j * math.pi * frequency / rate)
    polyval = np.polynomial.polynomial.polyval
    gain = np.abs(polyval(z, np.asarray(model["b"])) / polyval(z, np.asarray(model["a"])))
    top = int(np.argmax(gain))
    decade = slice(0, max(1, gain.size // 10))
    low, high = float(np.median(gain[decade])), float(np.median(gain[-decade.stop :]))
    sentences = [f"The gain is largest, {number(gain[top], 3)}, at {hertz(frequency[top])}."]
    if low > 0 and high > 0:
        ratio = high / low
        trend = (
            "a high-pass trend"
            if ratio > 2
            else "a low-pass trend"
            if ratio < 0.5
            else "no marked trend"
        )
        sentences.append(
            f"In the highest tenth of the band it is {number(ratio, 2)} times what it is in the"
            f" lowest: {trend}."
        )
    return [" ".join(sentences)]


def residuals(contents: Contents) -> list[str]:
    """How the residual tests came out."""
    validation = contents.validation
    share, lags = validation.get("autocorrelation_share_inside95"), validation.get("lags")
    box = validation.get("ljung_box") or {}
    cross = validation.get("cross_correlation") or {}
    sentences = []
    if is_number(share) and is_number(lags):
        sentences.append(
            f"{percent(100 * share)} of {count(lags)} residual autocorrelations lie inside the 95 %"
            f" bounds ±1.96/√N with N = {count(validation.get('residual_samples'))} residuals of"
            " the estimation samples; white residuals leave about 95 % there."
        )
    if is_number(box.get("p_value")):
        sentences.append(
            f"The Ljung-Box statistic over {count(box['lags'])} lags is"
            f" {number(box['statistic'], 4)} on {count(box['degrees_of_freedom'])} degrees of"
            f" freedom (lags less na + nc): {p_text(box['p_value'])}."
        )
    if is_number(cross.get("share_inside95")):
        sentences.append(
            f"{percent(100 * cross['share_inside95'])} of the cross-correlations with the input"
            f" over lags −{count(cross['lags'])} to {count(cross['lags'])} lie inside their bounds,"
            f" the largest being {number(cross.get('max_abs'), 2)}. These bounds take the"
            " autocorrelation of residuals and input into account (Ljung 1999, section 16.6)."
        )
    if not sentences:
        sentences.append("The residual tests could not be made: too few residuals.")
    return [" ".join(sentences)]


def simulation(contents: Contents) -> list[str]:
    """Simulation on data the model never saw, apart from prediction."""
    validation = contents.validation
    begin = (
        "It starts from the state that fits these samples best, as MATLAB's"
        " compare do; nothing else of their output is used."
    )
    if is_number(validation.get("continued_simulation_error_percent")):
        begin += (
            " Started with the estimation samples instead, and run on without seeing one"
            " validation output, the same model misses by"
            f" {percent(validation['continued_simulation_error_percent'])}: noise, which no"
            " simulation can know, has moved the state meanwhile."
        )
    sentences = [
        f"Driven by the input alone, the simulated output misses the measured one by"
        f" {percent(validation.get('simulation_error_percent'))} of its norm"
        f" ({percent(validation.get('simulation_fit_percent'))} NRMSE fit) over"
        f" {plural(validation.get('samples', 0), 'validation sample')}. {begin}"
    ]
    if validation.get("unscored_samples"):
        sentences.append(
            f"The first {count(validation['unscored_samples'])} samples have no complete past and"
            " are not scored."
        )
    return [" ".join(sentences)]


def stabilization_reading(contents: Contents) -> list[str]:
    """Which frequencies persist over the orders."""
    records = contents.phases.get("common", {}).get("candidates", [])
    table = stabilization(records, float(contents.model["sampling_rate"]))
    if table.empty:
        return ["No candidate of the common phase has an oscillating mode."]
    found = _persistent(table)
    orders = table["order"]
    lead = f"Over the orders {orders.min()} to {orders.max()},"
    if not found:
        return [f"{lead} no pole stays in place for {PERSISTENT} orders running."]
    return [
        f"{lead} poles stay in place, in frequency within 1 % and in damping within 10 %, for"
        f" {PERSISTENT} orders or more at {enumeration([hertz(f) for f in found])}."
    ]


def _persistent(table: pd.DataFrame) -> list[float]:
    """Median frequencies of clusters of stable poles that cover enough orders."""
    stable = table[table["status"] == "stable"].sort_values("frequency_hz")
    if stable.empty:
        return []
    step = stable["frequency_hz"].diff() / stable["frequency_hz"]
    clusters = stable.groupby((step > 0.02).cumsum())
    return [
        float(cluster["frequency_hz"].median())
        for _, cluster in clusters
        # A pole stable at n - 1 orders has stood at n.
        if cluster["order"].nunique() >= PERSISTENT - 1
    ]


def search(contents: Contents) -> list[str]:
    """What the search cost and how sure it is of its optimum."""
    candidates = contents.candidates
    sentences = [
        f"{plural(len(candidates), 'candidate')} took"
        f" {count(int(candidates['evaluations'].fillna(0).sum()))} evaluations of the objective."
    ]
    chosen = contents.chosen
    if chosen is None:
        return [" ".join(sentences)]
    history = np.asarray(chosen.get("convergence") or [], dtype=float)
    if history.ndim == 2 and history.shape[1] == 2 and history[-1, 1] > 0:
        near = history[history[:, 1] <= 1.001 * history[-1, 1]]
        sentences.append(
            f"The chosen model was within 0.1 % of its final objective after"
            f" {count(near[0, 0])} of {count(history[-1, 0])} evaluations."
        )
    objective = contents.model.get("objective") or {}
    if is_number(objective.get("value")):
        sentences.append(
            f"Its objective, “{objective.get('name')}”, ended at {number(objective['value'], 5)};"
            f" the fit on the estimation samples is"
            f" {percent(contents.model.get('fit_percent'), 4)}."
        )
    sentences += _evidence(chosen)
    sentences.append(_confirmed(candidates))
    return [" ".join(sentences)]


def _evidence(chosen: Mapping[str, Any]) -> list[str]:
    """What the search of one model says about its own optimum."""
    sentences = []
    populations, agreement = chosen.get("populations"), chosen.get("agreement")
    if is_number(populations) and is_number(agreement):
        others = int(populations) - 1
        text = f"It went through {plural(int(chosen.get('generations') or 0), 'generation')} of"
        if others < 1:
            text += (
                " one population, which used up its evaluations: no independent one confirms the"
                " optimum."
            )
        else:
            text += (
                f" {plural(int(populations), 'independent population')};"
                f" {count(round(agreement * others))} of the {count(others)} beside the one that"
                " found the optimum ended there too."
            )
        sentences.append(text)
    if is_number(chosen.get("basins")):
        sentences.append(
            "Its local searches that converged ended at"
            f" {plural(int(chosen['basins']), 'distinct value')}."
        )
    if is_number(chosen.get("checked")) and is_number(chosen.get("unseen")):
        sentences.append(_check(int(chosen["checked"]), float(chosen["unseen"])))
    if chosen.get("at_margin") is True:
        sentences.append(
            "A root of A or C lies at the largest radius that the search allows, where the limit"
            " and not the data holds it."
        )
    if chosen.get("noise_state"):
        sentences.append(
            f"The {plural(len(chosen['noise_state']), 'noise sample')} before the first residual"
            " were estimated with the coefficients, so that no transient of the start counts as an"
            " error."
        )
    return sentences


def _check(checked: int, unseen: float) -> str:
    """How far the optimum was checked from random points."""
    if checked == 0:
        return "No check from random points was made, since no two populations agreed before it."
    return (
        f"One of the populations is a check: descents from {count(checked)} random points, which"
        f" leave an estimated {number(100.0 * unseen, 2)} % of all such points that would lead to"
        " optima not seen."
    )


def _confirmed(candidates: pd.DataFrame) -> str:
    """How many of all candidates another population confirmed, and how many lie at the margin."""
    if not {"agreement", "at_margin"} <= set(candidates):
        return "Whether other populations confirmed the candidates is not on record."
    confirmed = int((candidates["agreement"] > 0).sum())
    margin = int((candidates["at_margin"].astype(str).str.lower() == "true").sum())
    return (
        f"Of all {count(len(candidates))} candidates {count(confirmed) if confirmed else 'none'}"
        f" {'was' if confirmed < 2 else 'were'} confirmed by another population and {count(margin)}"
        f" {'has' if margin == 1 else 'have'} a root at the margin; what was not confirmed may lie"
        " above its true optimum, and its criteria with it."
    )
