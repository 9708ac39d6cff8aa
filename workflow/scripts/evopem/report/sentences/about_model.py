"""Sentences about the model: its modes, poles and zeros, and frequency response."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
import pandas as pd

from evopem.figures.chart import rows_of
from evopem.figures.frequency_domain import model_source
from evopem.figures.view import View
from evopem.models.modes import Mode
from evopem.report.mode_table import ModeRow
from evopem.report.numbers import THIN, count, enumeration, fixed, hertz, number, plural
from evopem.report.sentences.about_recording import difference_gain
from evopem.signals.prepared_data import Transforms

# Below this number of time constants of a mode in the estimation samples, its asymptotic standard
# errors are too small (docs/evidence/coverage.md: 87 to 94 % coverage at 1.5, 94 to 96 % at 14).
FEW_TIME_CONSTANTS = 3.0
# Factor on the gain below which differencing is named as the reason of a missed mode.
STRONG_ATTENUATION = 0.1
# Responses that are told in words.
MOST_RESPONSES = 4


def modes(view: View, rows: Sequence[ModeRow]) -> list[str]:
    """Remarks on modes whose intervals are too narrow, and on true modes that were missed."""
    transforms = view.results.model.transforms
    duration = transforms.estimation_samples / view.sampling_rate
    sentences = []
    for place, row in enumerate(rows, start=1):
        if row.estimate is not None:
            sentences += _short(row.estimate, place, duration)
    missed = [row.truth for row in rows if row.estimate is None and row.truth is not None]
    if missed:
        sentences += _missed(missed, transforms)
    return [" ".join(sentences)] if sentences else []


def _short(mode: Mode, place: int, duration: float) -> list[str]:
    """Whether the estimation samples, in seconds, are short beside a mode's time constant."""
    time_constants = 2 * math.pi * mode.frequency_hz * mode.damping_ratio * duration
    if time_constants >= FEW_TIME_CONSTANTS:
        return []
    return [
        f"The estimation samples last only {number(time_constants, 2)} time constants of mode"
        f" {place}, so its 95{THIN}% intervals are somewhat too narrow."
    ]


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


def poles(view: View) -> list[str]:
    """Positions of poles and zeros, and how many of them have no known covariance."""
    record, rate = view.results.model, view.sampling_rate
    sentences = []
    if record.poles.size:
        slowest = float(np.abs(record.poles).max())
        text = f"The slowest pole has radius {fixed(slowest, 5)}"
        if 0 < slowest < 1:
            seconds = -1 / (rate * math.log(slowest))
            text += f"; its response decays to 37 % within {number(seconds, 3)}{THIN}s"
        total, real = record.poles.size, int(np.sum(record.poles.imag == 0))
        sentences.append(
            f"{text}. Of {plural(total, 'pole')}, {count(total - real)} form"
            f" {plural((total - real) // 2, 'oscillating mode')} and {count(real)}"
            f" {'is' if real == 1 else 'are'} real."
        )
    zeros = np.concatenate([*record.zeros, np.empty(0)])
    if zeros.size:
        outside = int(np.sum(np.abs(zeros) > 1))
        sentences.append(
            f"{plural(outside, 'zero')} of B {'lies' if outside == 1 else 'lie'} outside the unit"
            " circle, so the inverse of G is unstable."
            if outside
            else "All zeros of B lie inside the unit circle."
        )
    unknown = int(
        view.roots["variance_real"].isna().sum() - (view.roots["kind"] == "true pole").sum()
    )
    if unknown:
        sentences.append(
            f"The covariance of {plural(unknown, 'root')} is not known, so no ellipse is drawn."
        )
    if record.noise_zeros.size:
        radius = float(np.abs(record.noise_zeros).max())
        sentences.append(f"The largest zero of the noise filter has radius {fixed(radius, 5)}.")
    return [" ".join(sentences)]


def frequency_response(view: View) -> list[str]:
    """Where the gain of each pair is largest, and its trend over frequency."""
    kind, label = model_source(view)
    table = view.frequency_response
    table = table[(table["source"] == kind) & (table["frequency_hz"] > 0)]
    if len(view.pairs) > MOST_RESPONSES:
        return []
    return [
        " ".join(
            _response(rows_of(table, view.where(*pair)), view.pair_title(*pair) or label)
            for pair in view.pairs
        )
    ]


def _response(rows: pd.DataFrame, name: str) -> str:
    gain, frequency = rows["gain"].to_numpy(), rows["frequency_hz"].to_numpy()
    top = int(np.nanargmax(gain))
    text = (
        f"The gain of {name} is largest at {hertz(float(frequency[top]))},"
        f" where it is {number(float(gain[top]), 3)}."
    )
    tenth = max(len(gain) // 10, 1)
    low, high = float(np.median(gain[:tenth])), float(np.median(gain[-tenth:]))
    if low > 0 and high > 0:
        text += (
            f" Its median over the highest tenth of the band is {number(high / low, 2)} times that"
            f" over the lowest: {_trend(high / low)}."
        )
    return text


def _trend(ratio: float) -> str:
    if ratio > 2:
        return "a high-pass trend"
    return "a low-pass trend" if ratio < 0.5 else "no marked trend"
