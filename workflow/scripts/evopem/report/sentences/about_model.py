"""Sentences about the model: its modes, poles and zeros, and frequency response."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from evopem.models.modes import Mode
from evopem.models.polynomial import PolynomialModel
from evopem.models.uncertain_roots import uncertain_roots
from evopem.report.mode_table import ModeRow
from evopem.report.numbers import (
    THIN,
    count,
    enumeration,
    fixed,
    hertz,
    number,
    plural,
)
from evopem.report.numbers import root as root_text
from evopem.report.sentences.about_recording import difference_gain
from evopem.results.dataset import DatasetResults
from evopem.signals.preparation import Transforms
from evopem.validation.mode_trust import STRONG_DAMPING

# Below this number of time constants of a mode in the estimation samples, its asymptotic standard
# errors are too small (docs/evidence/coverage.md: 87 to 94 % coverage at 1.5, 94 to 96 % at 14).
FEW_TIME_CONSTANTS = 3.0
# Factor on the gain below which differencing is named as the reason of a missed mode.
STRONG_ATTENUATION = 0.1
# Frequencies at which the gain is evaluated for its maximum and trend.
FREQUENCIES = 8192


def modes(results: DatasetResults, rows: Sequence[ModeRow]) -> list[str]:
    """Remarks on modes that are no resonances, are uncertain, or were missed."""
    transforms, rate = results.model.transforms, results.model.sampling_rate
    sentences = []
    for place, row in enumerate(rows, start=1):
        if row.estimate is not None:
            sentences += _remarks(row.estimate, place, transforms.estimation_samples / rate, rate)
    sentences += _origins(results, rows)
    sentences += _of_noise(results)
    missed = [row.truth for row in rows if row.estimate is None and row.truth is not None]
    if missed:
        sentences += _missed(missed, transforms)
    return [" ".join(sentences)] if sentences else []


def _of_noise(results: DatasetResults) -> list[str]:
    """The modes that the noise filter has beside those of A."""
    model = results.model.polynomials
    own = model.modes_of_polynomial("d")
    if not own:
        return []
    listed = enumeration([hertz(mode.frequency_hz) for mode in own])
    return [f"The noise filter has {plural(len(own), 'mode')} of its own, at {listed}."]


def _origins(results: DatasetResults, rows: Sequence[ModeRow]) -> list[str]:
    """Which modes the input drives, which belong to the noise, and which recur at other orders."""
    with_input = results.model.has_input
    numbers = {row.estimate.pole: n for n, row in enumerate(rows, start=1) if row.estimate}
    tested = results.validation.modes
    judged = [(numbers[each.mode.pole], each) for each in tested if each.mode.pole in numbers]
    sentences = []
    for origin, words in (
        ("input", "respond to the input on the validation samples"),
        (
            "noise",
            "do not respond to the input; the noise model needs them"
            if with_input
            else "improve the prediction of the validation samples",
        ),
        (
            "neither",
            "neither respond to the input nor does the noise model need them"
            if with_input
            else "do not improve the prediction of the validation samples",
        ),
        (
            "not judged",
            "could not be tested for a response to the input"
            if with_input
            else "could not be tested on the validation samples",
        ),
    ):
        places = [str(place) for place, each in judged if each.origin == origin]
        if places:
            sentences.append(f"Of the modes, {enumeration(places)} {words}.")
    unstable = [str(place) for place, each in judged if each.stable is False]
    if unstable:
        verb = "is" if len(unstable) == 1 else "are"
        sentences.append(
            f"Of the modes, {enumeration(unstable)} {verb} not found again at most other orders."
        )
    return sentences


def _remarks(mode: Mode, place: int, duration: float, sampling_rate: float) -> list[str]:
    why = ""
    if mode.damping_ratio > STRONG_DAMPING:
        why = "has a damping ratio above 50 %"
    elif mode.frequency_hz > sampling_rate / 2:
        why = "has a natural frequency above half the sampling rate"
    if why:
        return [f"Mode {place} {why}: it is a fast-decaying pair of poles and not a resonance."]
    time_constants = 2 * math.pi * mode.frequency_hz * mode.damping_ratio * duration
    if time_constants < FEW_TIME_CONSTANTS:
        return [
            f"The estimation samples last only {number(time_constants, 2)} time constants of mode"
            f" {place}, so its 95{THIN}% intervals are somewhat too narrow."
        ]
    return []


def _missed(missed: Sequence[Mode], transforms: Transforms) -> list[str]:
    listed = enumeration([hertz(mode.frequency_hz) for mode in missed])
    several = len(missed) > 1
    sentences = [
        f"The true {'modes' if several else 'mode'} at {listed} {'were' if several else 'was'} not"
        " found."
    ]
    lowest = missed[0].frequency_hz
    factor = difference_gain(transforms, lowest)
    if factor < STRONG_ATTENUATION:
        sentences.append(
            f"At {hertz(lowest)}, differencing the output multiplies the gain by"
            f" {number(factor, 2)}, so the mode is weak in the prepared output."
        )
    return sentences


def poles(results: DatasetResults) -> list[str]:
    """Positions and uncertainty of poles and zeros."""
    model = results.model.polynomials
    found, zeros, noise_zeros = model.poles(), model.zeros(), model.noise_zeros()
    sentences = []
    if found.size:
        slowest = float(np.abs(found).max())
        text = f"The slowest pole has radius {fixed(slowest, 5)}"
        if 0 < slowest < 1:
            seconds = -1 / (model.sampling_rate * math.log(slowest))
            text += f"; its response decays to 37 % within {number(seconds, 3)}{THIN}s"
        real = int(np.sum(found.imag == 0))
        sentences.append(
            f"{text}. Of {plural(found.size, 'pole')}, {count(found.size - real)} form"
            f" {plural((found.size - real) // 2, 'oscillating mode')} and {count(real)}"
            f" {'is' if real == 1 else 'are'} real."
        )
    if zeros.size:
        outside = int(np.sum(np.abs(zeros) > 1))
        sentences.append(
            f"{plural(outside, 'zero')} of B {'lies' if outside == 1 else 'lie'} outside the unit"
            " circle, so the inverse of G is unstable."
            if outside
            else "All zeros of B lie inside the unit circle."
        )
    sentences.append(_largest_ellipses(model))
    if noise_zeros.size:
        radius = float(np.abs(noise_zeros).max())
        sentences.append(f"The largest root of C has radius {fixed(radius, 5)}.")
    return [" ".join(sentence for sentence in sentences if sentence)]


def _largest_ellipses(model: PolynomialModel) -> str:
    """The pole and the zero with the largest confidence ellipse, and the roots without one."""
    poles = [*uncertain_roots(model, "A"), *uncertain_roots(model, "F")]
    zeros = uncertain_roots(model, "B")
    largest, unknown = [], 0
    for roots, noun in ((poles, "pole"), (zeros, "zero")):
        known = [root for root in roots if root.covariance_known]
        unknown += len(roots) - len(known)
        if known:
            root = max(known, key=lambda root: root.half_axes[-1])
            radius = number(float(root.half_axes[-1]), 2)
            largest.append(f"{radius} for the {noun} {root_text(root.value)}")
    if not poles and not zeros:
        return ""
    if not largest:
        return "The covariance of the poles and zeros is not known, so no ellipse is drawn."
    text = (
        f"The longest half axis of a 95 % ellipse is {enumeration(largest)}; ellipses smaller than"
        " the markers are hidden."
    )
    if unknown:
        text += f" The covariance of {plural(unknown, 'root')} of A or B is not known."
    return text


def frequency_response(results: DatasetResults) -> list[str]:
    """Where the gain is largest, and its trend over frequency."""
    model = results.model.polynomials
    frequencies = np.linspace(0, model.sampling_rate / 2, FREQUENCIES + 1)[1:]
    response = model.frequency_response if model.has_input else model.noise_response
    gain = np.abs(response(frequencies)[:, 0, 0])
    top = int(np.argmax(gain))
    text = (
        f"The gain{'' if model.has_input else ' of the noise filter'} is largest at"
        f" {hertz(float(frequencies[top]))},"
        f" where it is {number(float(gain[top]), 3)}."
    )
    tenth = FREQUENCIES // 10
    low, high = float(np.median(gain[:tenth])), float(np.median(gain[-tenth:]))
    if low > 0 and high > 0:
        text += (
            f" Its median over the highest tenth of the band is {number(high / low, 2)} times that"
            f" over the lowest: {_trend(high / low)}."
        )
    return [text]


def _trend(ratio: float) -> str:
    if ratio > 2:
        return "a high-pass trend"
    return "a low-pass trend" if ratio < 0.5 else "no marked trend"
