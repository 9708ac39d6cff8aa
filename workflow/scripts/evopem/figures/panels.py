"""What the page draws again from a figure's table where a reader can zoom and read values.

The names of columns, roles of colour and labels are all that a page needs beside the table itself.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, dataclass
from typing import TYPE_CHECKING, Any, Literal

from evopem.config.structures import plant_order
from evopem.figures.frequency_domain import NOISE_FILTER, PLANT, plant_or_noise_filter
from evopem.figures.signal_labels import (
    prepared_input_name,
    prepared_output_name,
    prepared_output_unit,
)
from evopem.figures.style import ratio_unit, with_unit
from evopem.figures.time_responses import responses_of

if TYPE_CHECKING:
    from evopem.results.dataset import DatasetResults

Role = Literal["ink", "muted", "model", "error", "truth", "fourth", "fifth"]
Kind = Literal["line", "points", "stems", "steps"]


@dataclass(frozen=True)
class Curve:
    """One curve of a panel.

    Attributes
    ----------
    label : str
    column : str
        Column of the ordinate.
    colour : str
        Role of the colour, as in :mod:`evopem.figures.style`.
    kind : {"line", "points", "stems", "steps"}
    dashed : bool
    band : tuple of str
        Columns of the lower and upper limit of its band; empty for none.
    where : tuple of str
        A column and the value of the rows that belong to the curve, or ``"not 0"``; empty for all
        rows.
    factor : float
        Factor on the ordinate.
    source : str
        Figure that has the column in its table, on a logarithmic scale of its own without an axis;
        empty for the figure's own table and the common scale.
    """

    label: str
    column: str
    colour: Role
    kind: Kind = "line"
    dashed: bool = False
    band: tuple[str, ...] = ()
    where: tuple[str, ...] = ()
    factor: float = 1.0
    source: str = ""


@dataclass(frozen=True)
class Panel:
    """A panel: curves over one abscissa.

    Attributes
    ----------
    title : str
    x, x_label, y_label : str
        Column of the abscissa, and the labels of the axes.
    curves : tuple of Curve
    logarithmic : bool
        Whether the ordinate is logarithmic.
    wrapped : bool
        Whether the ordinate is an angle in degrees, drawn from −180 to 180.
    limits : tuple of float
        Fixed limits of the ordinate; empty where the data set them.
    highest : float
        Largest abscissa that is drawn; 0 where the data set it.
    height : int
        Pixels.
    marks : tuple of float
        Places on the abscissa that are marked by a vertical line.
    levels : tuple of float
        Places on the ordinate that are marked by a horizontal line.
    linked : str
        Panels of the page with the same word show the same part of their abscissa.
    """

    title: str
    x: str
    x_label: str
    y_label: str
    curves: tuple[Curve, ...]
    logarithmic: bool = False
    wrapped: bool = False
    limits: tuple[float, ...] = ()
    highest: float = 0.0
    height: int = 220
    marks: tuple[float, ...] = ()
    levels: tuple[float, ...] = ()
    linked: str = ""


def as_json_form(panels: Sequence[Panel]) -> list[dict[str, Any]]:
    """The panels as the page reads them."""
    return [asdict(panel) for panel in panels]


FREQUENCY = "Frequency (Hz)"
VALIDATION_TIME = "Time from the first validation sample (s)"


def has_input(results: DatasetResults) -> bool:
    """Whether the model has an input."""
    return results.model.model.has_input


def output_unit(results: DatasetResults) -> str:
    """Unit of the prepared output."""
    return prepared_output_unit(results.model.transforms, results.recording.output_unit)


def output_label(results: DatasetResults) -> str:
    """Name of the prepared output with its unit."""
    name = prepared_output_name(results.model.transforms, results.recording.output_name)
    return with_unit(name, output_unit(results))


def gain_unit(results: DatasetResults) -> str:
    """Unit of the gain from the prepared input to the prepared output; none without an input."""
    if not has_input(results):
        return ""
    return ratio_unit(output_unit(results), results.recording.input_unit)


def density_label(results: DatasetResults) -> str:
    """Label of a power spectral density of the prepared output."""
    unit = output_unit(results)
    return with_unit("Power spectral density", f"({unit})²/Hz" if unit else "per Hz")


def measured_and_simulated(results: DatasetResults) -> list[Panel]:
    """Panels of the first screen's simulation; without an input, of the prediction."""
    computed = "simulated" if has_input(results) else "predicted"
    curves = (
        Curve("measured", "output", "ink"),
        Curve(computed, computed, "error", dashed=True),
    )
    label = output_label(results)
    return [Panel("", "time_s", VALIDATION_TIME, label, curves, height=210)]


def _gain(results: DatasetResults) -> tuple[Curve, ...]:
    label, source = (PLANT, "model") if has_input(results) else (NOISE_FILTER, "noise filter")
    own = Curve(
        f"{label} with 95 % band",
        "gain",
        "model",
        band=("gain_lower", "gain_upper"),
        where=("source", source),
    )
    if not has_input(results):
        return (own,)
    return (Curve("multitaper", "gain", "muted", where=("source", "multitaper")), own)


def gain(results: DatasetResults, marks: Sequence[float]) -> list[Panel]:
    """Panel of the gain over the data."""
    return [
        Panel(
            "",
            "frequency_hz",
            FREQUENCY,
            with_unit("Gain", gain_unit(results)),
            _gain(results),
            logarithmic=True,
            limits=gain_limits(results),
            height=210,
            marks=tuple(marks),
            linked="frequency",
        )
    ]


def gain_limits(results: DatasetResults) -> tuple[float, ...]:
    """Limits of the gain around that of the model rather than the scatter of the data."""
    positive = plant_or_noise_filter(results.frequency_response)[0]["gain"]
    positive = positive[positive > 0]
    return (float(positive.min()) / 4, float(positive.max()) * 4) if len(positive) else ()


def frequency_response(results: DatasetResults) -> list[Panel]:
    """Gain, phase and coherence; without an input, gain and phase of the noise filter."""
    x = "frequency_hz"
    if not has_input(results):
        own = Curve(NOISE_FILTER, "phase_deg", "model", "points", where=("source", "noise filter"))
        return [*gain(results, ()), _phase((own,))]
    phase = (
        Curve("multitaper", "phase_deg", "muted", "points", where=("source", "multitaper")),
        Curve(PLANT, "phase_deg", "model", "points", where=("source", "model")),
    )
    coherence = (Curve("coherence", "coherence", "muted", where=("source", "multitaper")),)
    return [
        *gain(results, ()),
        _phase(phase),
        Panel(
            "", x, FREQUENCY, "Coherence", coherence, limits=(0, 1.05), height=120,
            linked="frequency",
        ),
    ]  # fmt: skip


def _phase(curves: tuple[Curve, ...]) -> Panel:
    return Panel(
        "",
        "frequency_hz",
        FREQUENCY,
        "Phase (°)",
        curves,
        wrapped=True,
        limits=(-190, 190),
        height=170,
        linked="frequency",
    )


def spectrum(results: DatasetResults) -> list[Panel]:
    """Spectrum of the prepared output."""
    curves = (Curve("estimate with 95 % band", "density", "ink", band=("lower", "upper")),)
    peaks = tuple(peak.frequency_hz for peak in results.spectrum_summary.peaks)
    return [
        Panel(
            "",
            "frequency_hz",
            FREQUENCY,
            density_label(results),
            curves,
            logarithmic=True,
            height=240,
            marks=peaks,
            linked="frequency",
        )
    ]


def residual_spectrum(results: DatasetResults) -> list[Panel]:
    """Spectrum of the one-step errors on the validation samples."""
    curves = (
        Curve("residuals with 95 % band", "density", "ink", band=("lower", "upper")),
        Curve("white noise of the same variance", "white_level", "error", dashed=True),
    )
    return [
        Panel(
            "",
            "frequency_hz",
            FREQUENCY,
            density_label(results),
            curves,
            logarithmic=True,
            linked="frequency",
        )
    ]


def simulation(results: DatasetResults) -> list[Panel]:
    """Measured, simulated and predicted output, and the errors."""
    errors: tuple[Curve, ...] = (
        Curve("of simulation", "simulation_error", "error", dashed=True),
        Curve("of one-step prediction", "prediction_error", "model"),
    )
    signals: tuple[Curve, ...] = (
        Curve("measured", "output", "ink"),
        Curve("predicted one step ahead", "predicted", "model"),
        Curve("simulated", "simulated", "error", dashed=True),
    )
    if not has_input(results):
        errors, signals = errors[1:], signals[:2]
    label = output_label(results)
    return [
        Panel("", "time_s", VALIDATION_TIME, label, signals, height=260, linked="validation"),
        Panel("Errors", "time_s", VALIDATION_TIME, "", errors, linked="validation"),
    ]


def simulation_as_recorded(results: DatasetResults) -> list[Panel]:
    """The same in the units of the recording."""
    curves: tuple[Curve, ...] = (
        Curve("measured", "recorded_output", "ink"),
        Curve("predicted one step ahead", "recorded_predicted", "model", dashed=True),
        Curve("simulated", "recorded_simulated", "error", dashed=True),
    )
    if not has_input(results):
        curves = curves[:2]
    label = with_unit(results.recording.output_name, results.recording.output_unit)
    return [Panel("", "time_s", VALIDATION_TIME, label, curves, height=260, linked="validation")]


def step_and_impulse(results: DatasetResults) -> list[Panel]:
    """Responses to a unit step and a unit impulse; without an input, of the noise filter."""
    return [
        Panel(
            with_unit(title, gain_unit(results)),
            "time_s",
            "Time (s)",
            "",
            (
                Curve(
                    "response with 95 % band",
                    column,
                    "model",
                    band=(f"{column}_lower", f"{column}_upper"),
                ),
            ),
            linked="response",
        )
        for column, title in responses_of(results.time_response)
    ]


def residuals(results: DatasetResults) -> list[Panel]:
    """Autocorrelation and, with an input, cross-correlation with their bounds."""

    def correlation(title: str, x_label: str, column: str, where: tuple[str, ...] = ()) -> Panel:
        bound = f"bound95_of_{column}"
        curves = (
            Curve("correlation", column, "ink", "stems", where=where),
            Curve("95 % bounds", bound, "model", dashed=True, where=where),
            Curve("", bound, "model", dashed=True, where=where, factor=-1.0),
        )
        return Panel(title, "lag", x_label, "", curves)

    # At lag 0 the autocorrelation is 1 by definition.
    of_themselves = correlation(
        "Autocorrelation of the residuals",
        "Lag (samples)",
        "autocorrelation",
        ("lag", "not 0"),
    )
    if not has_input(results):
        return [of_themselves]
    return [
        of_themselves,
        correlation(
            "Cross-correlation of residuals and input",
            "Lag (samples)",
            "cross_correlation",
        ),
    ]


def stabilization(results: DatasetResults) -> list[Panel]:
    """Poles over the order, by their status; the line marks the selected order."""
    order = plant_order(results.model.orders.structure)
    curves = (
        Curve("spectrum of the output", "density", "muted", source="spectrum"),
        *(
            Curve(label, "order", colour, "points", where=("status", status))
            for status, label, colour in _STATUSES
        ),
    )
    return [
        Panel(
            "",
            "frequency_hz",
            "Natural frequency (Hz)",
            f"Order {order}",
            curves,
            height=280,
            highest=results.model.sampling_rate / 2,
            levels=(float(getattr(results.models_of_orders.orders, order)),),
            linked="frequency",
        )
    ]


_STATUSES: tuple[tuple[str, str, Role], ...] = (
    ("new", "new", "muted"),
    ("frequency", "stable in frequency", "fourth"),
    ("stable", "stable in frequency and damping", "model"),
)


def record(results: DatasetResults) -> list[Panel]:
    """Input and output as recorded and as used."""
    recording, transforms = results.recording, results.model.transforms
    shown_signals = ("input", "output") if recording.has_input else ("output",)
    used_input = with_unit(
        prepared_input_name(transforms, recording.input_name), recording.input_unit
    )
    used = (("estimation", "ink"), ("validation", "model"))
    shown: list[Panel] = []
    for title, stages, labels, linked in (
        (
            "As recorded",
            (("recorded", "ink"),),
            (
                with_unit(recording.input_name, recording.input_unit),
                with_unit(recording.output_name, recording.output_unit),
            ),
            "recorded",
        ),
        ("As used", used, (used_input, output_label(results)), "used"),
    ):
        for column, label in zip(shown_signals, labels[-len(shown_signals) :], strict=True):
            curves = tuple(
                Curve(stage, column, role, where=("stage", stage))  # type: ignore[arg-type]
                for stage, role in stages
            )
            heading = title if column == shown_signals[0] else ""
            shown.append(
                Panel(heading, "time_s", "Time (s)", label, curves, height=170, linked=linked)
            )
    return shown


def convergence(_: DatasetResults) -> list[Panel]:
    """Lowest objective over the evaluations."""
    curve = Curve("lowest objective", "lowest_objective", "model", "steps")
    label = "Objective evaluations"
    return [Panel("", "evaluations", label, "Lowest objective", (curve,))]
