"""Figures show the data they are given, whatever the names, and the same bytes each time."""

import subprocess
import sys
import time
from dataclasses import replace
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
import pandas as pd
import pytest
from identified import with_model, with_outcome, with_output_name, without_covariance

from evopem.figures import CHARTS
from evopem.figures.chart import Chart, Curve, Panel, rows_of
from evopem.figures.draw import draw, unwrapped_gaps
from evopem.figures.frequency_domain import complex_plane, residual_spectra
from evopem.figures.orders import convergence, delay, phases, stabilization
from evopem.figures.style import svg_text
from evopem.figures.time_domain import settling_part, shown_samples
from evopem.models.mode_matching import PoleOfOrder
from evopem.models.polynomial import PolynomialModel
from evopem.results.layout import FIGURES
from evopem.validation.error_parts import ErrorParts, Levels, Part

HOSTILE = """<script>alert("1")</script> $x^2$ & 'q', \\frac"""


@pytest.fixture(scope="module")
def results(identified):
    return identified.results


def drawn(results, name):
    """The axes of a figure, as matplotlib draws it."""
    return draw(CHARTS[name](results)).axes


def lines(axes):
    return {line.get_label(): line for line in axes.get_lines()}


def assert_drawn(axes, x, y):
    """Some line on the axes goes through exactly these points."""
    for line in axes.get_lines():
        if len(line.get_xdata()) == len(x):
            both = np.column_stack([line.get_xdata(), line.get_ydata()]).astype(float)
            if np.allclose(both, np.column_stack([x, y]), equal_nan=True):
                return
    raise AssertionError("no line has these data")


def words(figure):
    """All text in the figure's SVG."""
    root = ElementTree.fromstring(svg_text(figure))
    return " ".join("".join(e.itertext()) for e in root.iter("{http://www.w3.org/2000/svg}text"))


def test_record_before_and_after(results):
    recording, prepared = results.recording, results.prepared
    before_u, after_u, before_y, after_y = drawn(results, "record")
    rate, fitted = recording.sampling_rate, prepared.estimation.samples
    time_axis = np.arange(recording.samples) / rate
    for axes, values in ((before_u, recording.input), (before_y, recording.output)):
        (line,) = axes.get_lines()
        assert line.get_ydata().max() == values.max()
        assert line.get_xdata()[-1] <= time_axis[-1]
    estimation = lines(after_u)["estimation"]
    assert estimation.get_ydata().min() == prepared.estimation.input.min()
    assert estimation.get_xdata().max() <= fitted / rate
    assert lines(after_y)["validation"].get_xdata().min() == pytest.approx(fitted / rate)
    label = after_y.get_ylabel().replace("\n", " ")
    assert label == "second difference of Box-Cox transformed output"


def test_units_are_shown_where_the_transforms_leave_them(results):
    linear = replace(results.model, transforms=replace(results.model.transforms, box_cox=None))
    named = replace(results.recording, output_names=("tip",), output_units=("m/s²",))
    _, _, before, after = drawn(replace(results, model=linear, recording=named), "record")
    assert before.get_ylabel() == "tip (m/s²)"
    assert after.get_ylabel().replace("\n", " ") == "second difference of tip (m/s²)"


def test_a_million_samples_draw_quickly_and_small():
    values = np.random.default_rng(0).normal(size=1_000_000)
    table = pd.DataFrame({"time_s": np.arange(1_000_000) / 50.0, "output": values})
    panel = Panel("", "time_s", "Time (s)", "tip", (Curve("measured", "output", "ink"),))
    started = time.process_time()
    figure = draw(Chart(table, (panel,)))
    text = svg_text(figure)
    assert time.process_time() - started < 5
    assert len(text) < 600_000
    (line,) = figure.axes[0].get_lines()
    assert (line.get_ydata().min(), line.get_ydata().max()) == (values.min(), values.max())


def test_spectrum_with_band_peaks_and_truth(results):
    (axes,) = drawn(results, "spectrum")
    shown, peaks = results.spectrum.iloc[1:], results.spectrum_summaries[0].peaks
    density = lines(axes)["estimate with 95 % band"].get_ydata()
    assert density.max() == pytest.approx(shown["density"].max())
    (band,) = axes.collections
    assert band.get_paths()[0].vertices[:, 1].max() == pytest.approx(shown["upper"].max())
    assert len(peaks) == 2
    found = lines(axes)["peaks"].get_xdata()
    np.testing.assert_allclose(found, [peak.frequency_hz for peak in peaks])
    named = {text.get_text() for text in axes.texts}
    assert named == {f"{peak.frequency_hz:.4g} Hz" for peak in peaks}
    marked = [line.get_xdata()[0] for line in axes.get_lines() if len(line.get_xdata()) == 2]
    for mode in results.truth.modes:
        assert mode.frequency_hz in marked


def test_frequency_response_with_band_data_and_coherence(results):
    gain, phase, coherence = drawn(results, "frequency_response")
    table = results.frequency_response.iloc[1:]
    model = lines(gain)["model G with 95 % band"].get_ydata()
    assert model.max() == pytest.approx(table["gain"].max())
    upper = table["gain_upper"].max()
    assert gain.collections[0].get_paths()[0].vertices[:, 1].max() == pytest.approx(upper)
    assert phase.get_ylim() == (-190, 190)
    assert lines(coherence)["coherence"].get_ydata().max() == pytest.approx(
        results.spectrum["coherence"].iloc[1:].max()
    )


def test_a_phase_breaks_where_it_wraps():
    x, y = unwrapped_gaps(np.arange(4.0), np.array([170.0, 190.0, 210.0, 400.0]))
    np.testing.assert_array_equal(x, [0, 0, 1, 2, 2, 3] if len(x) == 6 else [0, 0, 1, 2, 3])
    assert np.isnan(y[1])
    assert np.nanmax(np.abs(y)) <= 180


def test_poles_with_ellipses_and_modes_with_intervals(results):
    circle, damping = drawn(results, "poles_zeros")
    model, modes = results.model.model, results.model.modes
    poles = lines(circle)["poles"]
    found = np.sort_complex(poles.get_xdata() + 1j * poles.get_ydata())
    np.testing.assert_allclose(found, np.sort_complex(model.poles()), atol=1e-9)
    assert len(circle.patches) > 0
    bars = [each.get_segments() for each in damping.collections[:2]]
    half = {1.959963984540054 * mode.frequency_se_hz for mode in modes}
    drawn_halves = {np.ptp(bar[:, 0]) / 2 for bar in bars[0]} | {
        np.ptp(bar[:, 0]) / 2 for bar in bars[1]
    }
    for each in half:
        assert any(np.isclose(each, other, rtol=1e-6) for other in drawn_halves)


def test_without_covariance_no_ellipse_is_drawn(results):
    unknown = replace(results, model=without_covariance(results.model))
    circle, _ = drawn(unknown, "poles_zeros")
    assert len(circle.patches) == 0


POLES = (
    PoleOfOrder(4, 10.0, 0.1, "new"),
    PoleOfOrder(5, 10.0, 0.1, "frequency"),
    PoleOfOrder(6, 10.0, 0.1, "stable"),
    PoleOfOrder(6, 30.0, 0.1, "new"),
)


def with_poles(results, poles):
    """The results with other poles of the models of all orders."""
    return with_outcome(results, modes=replace(results.validation.modes, poles=poles))


def test_stabilization_marks_each_status_and_the_selected_order(results):
    (axes,) = draw(stabilization(with_poles(results, POLES))).axes
    found = lines(axes)
    assert list(found["new"].get_xdata()) == [10.0, 30.0]
    assert list(found["new"].get_ydata()) == [4, 6]
    assert list(found["stable in frequency"].get_ydata()) == [5]
    assert list(found["stable in frequency and damping"].get_ydata()) == [6]
    assert list(found["selected"].get_ydata()) == 2 * [results.validation.modes.order]


def test_the_first_screen_shows_the_simulation_and_the_gain_over_the_data(results):
    table = results.validation_tables.simulation
    (axes,) = drawn(results, "measured_and_simulated")
    shown = table[table["simulated_output"].notna()].iloc[: shown_samples(results)]
    for column in ("output", "simulated"):
        assert_drawn(axes, shown["time_s"], shown[f"{column}_output"])
    (axes,) = drawn(results, "gain")
    # The response has more points than are drawn: its extremes are.
    gain = lines(axes)["model G with 95 % band"].get_ydata()
    assert gain.max() == pytest.approx(results.frequency_response["gain"].iloc[1:].max())
    marked = [line.get_xdata()[0] for line in axes.get_lines() if len(line.get_xdata()) == 2]
    assert marked == [mode.frequency_hz for mode in results.validation.modes.trusted]


def test_levels_of_noise_and_distortion_are_drawn_below_the_gain(results):
    output = results.outputs[0].name
    levels = Levels(output, (1.0, 2.0, 3.0), (1e-3, 2e-3, 1e-3), (0.1, 0.2, 0.3))
    parts = ErrorParts(output, 6.4, Part(1.1, 1.0, 1.2), Part(4.9, 4.2, 5.6), Part(4.0, 3.1, 4.7))
    distortion = replace(
        results.validation.distortion, levels=(levels,), outputs=(parts,), p_value=1e-9
    )
    alone = replace(distortion, p_value=0.5)
    noise, both = (
        replace(results, validation=replace(results.validation, distortion=each))
        for each in (alone, distortion)
    )
    assert "from distortion" not in lines(drawn(noise, "gain")[0])
    (axes,) = drawn(both, "gain")
    assert lines(axes)["from noise"].get_ydata() == pytest.approx(levels.noise)
    assert lines(axes)["from distortion"].get_ydata() == pytest.approx(levels.distortion)
    low = axes.get_ylim()[0]
    assert 1e-6 < low < 1e-3
    bands = [area.get_paths()[0].get_extents() for area in axes.collections]
    tops = [band.y1 for band in bands if band.y0 < low]
    assert sorted(tops) == pytest.approx([2e-3, 0.3])


def test_the_gain_from_the_data_is_drawn_where_it_is_known(results):
    """Between the lines of an input it is anything, and its band reaches down to 0."""
    spectrum = results.spectrum.copy()
    between = np.arange(len(spectrum)) % 3 > 0
    spectrum.loc[between, "frequency_response_gain"] = 1e9
    spectrum.loc[between, "frequency_response_gain_lower"] = 0.0
    (axes,) = drawn(replace(results, spectrum=spectrum), "gain")
    gain = lines(axes)["from the data"].get_ydata()
    assert len(gain) > 100
    assert gain.max() < 1e3


def test_step_and_impulse_are_those_of_the_transfer_function(results):
    from scipy.signal import dlti, dstep

    model, table = results.model.model, settling_part(results)
    numerator = np.zeros(max(len(model.delayed_b()), len(model.A)))
    denominator = np.zeros_like(numerator)
    numerator[: len(model.delayed_b())] = model.delayed_b()
    denominator[: len(model.A)] = model.A
    times, (step,) = dstep(dlti(numerator, denominator, dt=1 / 100.0), n=len(table))
    np.testing.assert_allclose(table["step"], step[:, 0], atol=1e-9)
    np.testing.assert_allclose(table["time_s"], times)
    impulse = table["impulse"].abs()
    assert impulse.iloc[-5:].max() < 0.02 * impulse.max()
    for axes, column in zip(drawn(results, "step_and_impulse"), ("step", "impulse"), strict=True):
        assert_drawn(axes, table["time_s"], table[column])
        band = axes.collections[0].get_paths()[0].vertices[:, 1]
        assert band.max() == pytest.approx(table[f"{column}_upper"].max())


@pytest.fixture(scope="module")
def of_noise_alone(results):
    """The same results as if the model had no input, whose noise filter is left."""
    record = results.model
    known = record.polynomials
    noise = PolynomialModel(known.A, (), known.C, sampling_rate=known.sampling_rate)
    plain = with_model(record, noise)
    response, in_time = results.frequency_response.copy(), results.time_response.copy()
    response[["gain", "gain_lower", "gain_upper", "phase_deg"]] = np.nan
    in_time[["step", "impulse"]] = np.nan
    response["input"] = in_time["input"] = np.nan  # as files of outputs alone are read
    tables = results.validation_tables
    simulation = tables.simulation.assign(
        simulated_output=np.nan, simulation_error_output=np.nan, recorded_simulated_output=np.nan
    )
    return replace(
        results,
        model=plain,
        settings=replace(
            results.settings, order_grid=replace(results.settings.order_grid, structure="arma")
        ),
        phases={name: results.phases[name] for name in ("plant", "nc")},
        candidates=results.candidates[results.candidates["phase"].isin(["plant", "nc"])],
        spectrum=results.spectrum[["output", "frequency_hz", "density", "lower", "upper"]],
        frequency_response=response,
        time_response=in_time,
        validation_tables=replace(tables, simulation=simulation),
    )


def test_without_an_input_the_noise_filter_and_the_prediction_are_drawn(of_noise_alone):
    charts = {name: chart_of(of_noise_alone) for name, chart_of in CHARTS.items()}
    shown = {name: chart for name, chart in charts.items() if not chart.nothing}
    assert set(FIGURES) - set(shown) == {"nyquist", "delay"}
    noise = of_noise_alone.frequency_response["noise_gain"].iloc[1:]
    gain = shown["gain"].table
    assert set(gain["source"]) == {"noise filter"}
    assert gain["gain"].max() == noise.max()
    first = shown["measured_and_simulated"].table
    assert list(first.columns) == ["time_s", "output_output", "predicted_output"]
    assert first["predicted_output"].notna().all()
    (axes,) = drawn(of_noise_alone, "step_and_impulse")
    part = settling_part(of_noise_alone)
    assert len(part) > 10
    assert_drawn(axes, part["time_s"], part["noise_impulse"])


@pytest.mark.parametrize("kind", ["with input", "without"])
def test_every_curve_has_its_columns_and_rows(results, of_noise_alone, kind):
    """The page draws a panel from these columns of the figure's own table or of a named one."""
    shown = results if kind == "with input" else of_noise_alone
    charts = {name: chart_of(shown) for name, chart_of in CHARTS.items()}
    curves = 0
    for name, chart in charts.items():
        for panel in () if chart.nothing else chart.panels:
            for curve in panel.curves:
                table = charts[curve.source or name].table
                extra = (curve.bounds, curve.names, *curve.band, *curve.errors, *curve.ellipse)
                assert {panel.x, curve.column, *filter(None, extra)} <= set(table), name
                curves += len(rows_of(table, curve.where)) > 0
    assert curves > 30


def test_the_nyquist_diagram_shows_the_frequency_response_in_the_complex_plane(results):
    table = results.frequency_response
    response = results.model.model.frequency_response(table["frequency_hz"])[:, 0, 0]
    parts = complex_plane(table["gain"], table["phase_deg"])
    np.testing.assert_allclose(parts[:, 0] + 1j * parts[:, 1], response, rtol=1e-6, atol=1e-9)
    (axes,) = drawn(results, "nyquist")
    x, y = lines(axes)["model G"].get_data()
    assert np.abs(response[:, None] - (x + 1j * y)).min(axis=0).max() < 1e-5
    assert axes.get_xlim() == axes.get_ylim()


def test_the_level_of_white_noise_goes_through_the_residual_spectrum(results):
    table = residual_spectra(results)
    errors = results.validation_tables.simulation["prediction_error_output"].dropna()
    step = table["frequency_hz"].iloc[1]
    assert table["density"].sum() * step == pytest.approx(errors.var(ddof=0), rel=1e-6)
    assert table["density"].mean() == pytest.approx(table["white_level"].iloc[0], rel=0.01)
    (axes,) = drawn(results, "residual_spectrum")
    level = lines(axes)["white noise of the same variance"].get_ydata()
    np.testing.assert_allclose(level, table["white_level"].iloc[0])


def test_the_simulation_is_drawn_in_recorded_units(results):
    table = results.validation_tables.simulation
    (axes,) = drawn(results, "simulation_as_recorded")
    for line, column in zip(
        axes.get_lines(),
        ("recorded_output", "recorded_predicted", "recorded_simulated"),
        strict=True,
    ):
        assert np.nanmax(line.get_ydata()) == pytest.approx(table[f"{column}_output"].max())


def test_residuals_beyond_their_bounds_stand_out(results):
    own, crossed = drawn(results, "residual_correlation")
    table = results.validation_tables.cross_correlation
    outside = table[table["cross_correlation"].abs() > table["bound95"]]
    dots = [line for line in crossed.get_lines() if line.get_marker() == "."]
    np.testing.assert_allclose(dots[0].get_xdata(), outside["lag"])
    assert 0 not in lines(own)["inside"].get_xdata()


def test_convergence_ends_where_the_search_did(results):
    history = results.phases["nb"].selected.diagnostics.convergence
    figure = draw(convergence(results))
    evaluations, best = zip(*history, strict=True)
    assert_drawn(figure.axes[0], evaluations, best)
    assert f"{best[-1]:.6g}" in words(figure)


def with_history(results, *history):
    """The results with another history of the search."""
    search = results.model.search
    found = replace(search, diagnostics=replace(search.diagnostics, convergence=history))
    return replace(results, model=replace(results.model, search=found))


def test_the_last_digits_of_a_search_are_not_enlarged(results):
    low, high = (
        draw(convergence(with_history(results, (1000, 3.5903), (2000, 3.5902)))).axes[0].get_ylim()
    )
    assert high - low == pytest.approx(0.01 * 3.5902)
    assert low < 3.5902 < 3.5903 < high


@pytest.mark.parametrize("factor", [1.0, -2e-5])
def test_no_label_is_cut_off(results, factor):
    tables = results.validation_tables
    simulation = tables.simulation.copy()
    signals = simulation.columns[simulation.columns.str.contains("_")].drop("time_s")
    simulation[signals] *= factor
    drawn_anew = replace(results, validation_tables=replace(tables, simulation=simulation))
    for name in FIGURES:
        figure = draw(CHARTS[name](drawn_anew))
        box, (width, height) = figure.get_tightbbox(), figure.get_size_inches()
        assert min(box.x0, box.y0, width - box.x1, height - box.y1) > 0, name


def test_what_is_missing_is_said(results):
    of_nb = results.candidates[results.candidates["phase"] == "nb"]
    results = replace(results, candidates=of_nb)
    assert "no candidates of the delay search" in words(draw(delay(results)))
    assert len(draw(phases(results)).axes) == 6
    assert "is empty" in words(draw(convergence(with_history(results))))
    assert "No candidate" in words(draw(stabilization(with_poles(results, ()))))


def test_hostile_names_are_drawn_as_text(results):
    results = with_output_name(results, HOSTILE, output_units=("V",))
    for name in ("record", "simulation"):
        figure = draw(CHARTS[name](results))
        assert "<script" not in svg_text(figure)
        # A long label is folded over several lines, of which three are kept.
        assert "".join(HOSTILE.split())[:20] in "".join(words(figure).split())
    assert "$x^2$" in words(draw(CHARTS["record"](results)))


PROGRAM = """
import sys
import pandas as pd
from evopem.figures.chart import Chart, Curve, Panel
from evopem.figures.draw import draw
from evopem.figures.style import svg_text
table = pd.DataFrame({"x": [1.0, 5.0, 9.0], "y": [3.0, 2.0, 1.7]})
panel = Panel("", "x", "x", "y", (Curve("c", "y", "ink"),))
sys.stdout.write(svg_text(draw(Chart(table, (panel,)))))
"""


def test_equal_data_give_equal_bytes_in_another_process():
    run = subprocess.run(
        [sys.executable, "-c", PROGRAM],
        env={"PYTHONHASHSEED": "1", "PYTHONPATH": ":".join(sys.path)},
        check=True,
        capture_output=True,
        text=True,
    )
    table = pd.DataFrame({"x": [1.0, 5.0, 9.0], "y": [3.0, 2.0, 1.7]})
    panel = Panel("", "x", "x", "y", (Curve("c", "y", "ink"),))
    assert run.stdout == svg_text(draw(Chart(table, (panel,))))
    assert "<svg" in run.stdout


def test_the_settings_of_matplotlib_are_restored(results):
    import matplotlib as mpl

    before = dict(mpl.rcParams)
    drawn(results, "convergence")
    assert dict(mpl.rcParams) == before


def test_the_data_of_every_figure_are_files_of_the_results(identified):
    for figure in FIGURES.values():
        for file in figure.data:
            assert (Path(identified.files.folder) / file).exists()
