"""The parts of the simulation error in words: noise, nonlinear distortion, the model."""

from evopem.report.numbers import percent, plural
from evopem.validation.distortion import Distortion
from evopem.validation.error_parts import ErrorParts


def error_parts(distortion: Distortion) -> list[str]:
    """A sentence for each of four outputs, the largest errors first; none where not judged."""
    outputs = sorted(distortion.outputs, key=lambda output: -output.error_percent)
    return [_sentence(distortion, output, len(outputs) > 1) for output in outputs[:4]]


def _sentence(distortion: Distortion, parts: ErrorParts, several: bool) -> str:
    """What the error of an output consists of."""
    samples = f" of the {distortion.on} samples"
    of_output = f" of {parts.name}" if several else ""
    of = f"Of the simulation error{of_output} of {percent(parts.error_percent)} over"
    periods = plural(distortion.periods, "period")
    if distortion.realisations > 1:
        periods = f"{periods} each of {distortion.realisations} realisations"
    noise = f"{percent(parts.noise.percent, 2)} is noise"
    extra, rest = parts.distortion, percent(parts.rest.percent, 2)
    if not distortion.shown:
        limit = f"at most {percent(extra.high, 2)} can be there"
        if not distortion.separated:
            limit = "but it would not all show beside the lines of this input"
        split = f"{noise} and {rest} this model; no nonlinear distortion shows ({limit})"
    else:
        least = "" if distortion.separated else "at least "
        split = (
            f"{noise}, {least}{percent(extra.percent, 2)} ({percent(extra.low, 2)} to"
            f" {percent(extra.high, 2)}) nonlinear distortion, which no linear model removes, and"
            f" {rest} this model{'' if distortion.separated else ' or more distortion'}"
        )
    return f"{of} {periods}{samples}, {split}. The parts add up in squares."
