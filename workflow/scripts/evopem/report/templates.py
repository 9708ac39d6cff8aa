"""The Jinja environment of the pages: filters for numbers, what sentences tell, and the scripts."""

from __future__ import annotations

import hashlib
import math
from base64 import b64encode
from collections.abc import Iterator, Sequence
from inspect import getmembers, isfunction
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from evopem.config.schema import shipped
from evopem.figures.chart import of_pair, rows_of
from evopem.models.mode_matching import PERSISTENT_ORDERS, persistent_frequencies
from evopem.models.modes import Mode
from evopem.report import numbers
from evopem.report.equations import symbol
from evopem.report.results_text import delay_words
from evopem.results.dataset import DatasetResults
from evopem.signals.peaks import line_spacing
from evopem.signals.prepared_data import Transforms
from evopem.validation.checks.check import p_text, root_text

if TYPE_CHECKING:
    from jinja2 import Environment

Context = dict[str, Any]  # what a template is given, by name

NEAR = 1.001  # the search counts as near its final objective from this ratio on


def difference_gain(transforms: Transforms, frequency: float) -> float:
    """Factor |2 sin(πf/fs)|^d on the gain, d the output's differences beyond the input's."""
    surplus = transforms.difference - transforms.difference_input
    return float(abs(2 * math.sin(math.pi * frequency / transforms.sampling_rate)) ** surplus)


def time_constants(results: DatasetResults, mode: Mode) -> float:
    """Length of the estimation samples in time constants of a mode."""
    duration = results.model.transforms.estimation_samples / results.model.sampling_rate
    return 2 * math.pi * mode.frequency_hz * mode.damping_ratio * duration


def evaluations_to_near(history: Sequence[tuple[int, float]]) -> int:
    """Evaluations after which a search was within 0.1 % of its final objective."""
    return next(spent for spent, value in history if value <= NEAR * history[-1][1])


def counted_roots(results: DatasetResults) -> Context:
    """Numbers of poles and zeros, and how far out the outermost ones are."""
    record, kinds = results.model, results.roots["kind"]
    zeros_of_noise = record.noise_zeros if record.has_noise_model else np.empty(0)
    slowest = float(np.abs(record.poles).max(initial=0.0))
    zeros = np.concatenate([*record.zeros, np.empty(0)])
    stable = 0 < slowest < 1
    return {
        "poles": record.poles.size,
        "real": int(np.sum(record.poles.imag == 0)),
        "slowest": slowest,
        "decay_s": -1 / (results.model.sampling_rate * math.log(slowest)) if stable else math.nan,
        "zeros": zeros.size,
        "outside": int(np.sum(np.abs(zeros) > 1)),
        "unknown": int(results.roots["variance_real"].isna().sum() - (kinds == "true pole").sum()),
        "noise_zero": float(np.abs(zeros_of_noise).max()) if zeros_of_noise.size else None,
    }


def gains_in_words(results: DatasetResults) -> Iterator[Context]:
    """Where the gain of each pair is largest, and its medians at both ends of the band."""
    kind, label = results.model_source
    table = results.responses
    table = table[(table["source"] == kind) & (table["frequency_hz"] > 0)]
    for pair in results.pairs:
        rows = rows_of(table, of_pair(*pair))
        gain, top = rows["gain"].to_numpy(), int(np.nanargmax(rows["gain"]))
        tenth = max(len(gain) // 10, 1)
        low, high = float(np.median(gain[:tenth])), float(np.median(gain[-tenth:]))
        yield {
            "name": results.pair_title(*pair) or label,
            "at": float(rows["frequency_hz"].iloc[top]),
            "largest": float(gain[top]),
            "ratio": high / low if low > 0 and high > 0 else None,
        }


def template_folder() -> Path:
    """The folder of the templates."""
    return shipped("templates")


def environment(folder: Path) -> Environment:
    """The environment that renders the templates of a folder; names are escaped."""
    from jinja2 import Environment, FileSystemLoader, StrictUndefined

    environment = Environment(
        loader=FileSystemLoader(folder),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
        keep_trailing_newline=True,
    )
    words = dict(getmembers(numbers, isfunction))
    of_sentences = (
        *(counted_roots, delay_words, difference_gain, evaluations_to_near, gains_in_words),
        *(line_spacing, persistent_frequencies, time_constants),
    )
    environment.filters.update(words)
    environment.tests["finite"] = numbers.is_number
    environment.globals.update(
        words | {function.__name__: function for function in of_sentences},
        persistent_orders=PERSISTENT_ORDERS,
        symbol=symbol,
        p_value=p_text,
        root=root_text,
        page_script=_script(folder / "page.js"),
        figures_script=_script(
            folder / "uplot" / "uPlot.iife.min.js",
            folder / "panels.js",
            folder / "figures.js",
            licence=folder / "uplot" / "LICENSE",
        ),
    )
    return environment


def _script(*files: Path, licence: Path | None = None) -> dict[str, str]:
    """A script of the page, and the digest by which the content policy allows it."""
    parts = [file.read_text(encoding="utf-8") for file in files]
    if licence is not None:
        parts.insert(0, f"/*\n{licence.read_text(encoding='utf-8')}\n*/")
    text = "\n".join(parts)
    digest = b64encode(hashlib.sha256(text.encode()).digest()).decode()
    return {"text": text, "digest": f"sha256-{digest}"}
