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

from evopem.figures import REPORT_FIGURES, draw_all
from evopem.figures.convergence import draw_convergence
from evopem.figures.figure_data import gain_table, residual_spectrum_table
from evopem.figures.frequency_domain import (
    complex_plane,
    draw_frequency_response,
    draw_nyquist,
    draw_residual_spectrum,
    draw_spectrum,
    unwrapped_gaps,
)
from evopem.figures.order_criteria import draw_delay, draw_phases
from evopem.figures.pole_zero_map import draw_poles_zeros
from evopem.figures.residual_correlation import draw_residuals
from evopem.figures.stabilization_diagram import draw_stabilization
from evopem.figures.style import svg_text
from evopem.figures.summary import draw_gain_and_data, draw_measured_and_simulated, shown_samples
from evopem.figures.time_domain import draw_record, draw_simulation, draw_simulation_as_recorded
from evopem.figures.time_responses import draw_step_and_impulse, settling_part
from evopem.results.layout import FIGURES
from evopem.signals.preparation import PreparedData
from evopem.signals.recording import Recording
from evopem.signals.spectral.peaks import SpectralPeak

HOSTILE = """<script>alert("1")</script> $x^2$ & 'q' \\frac"""


@pytest.fixture(scope="module")
def results(identified):
    return identified.results


def lines(axes):
    return {line.get_label(): line for line in axes.get_lines()}


def assert_drawn(axes, x, y):
    """Some line on the axes goes through exactly these points."""
    for line in axes.get_lines():
        if len(line.get_xdata()) == len(x):
            drawn = np.column_stack([line.get_xdata(), line.get_ydata()]).astype(float)
            if np.allclose(drawn, np.column_stack([x, y]), equal_nan=True):
                return
    raise AssertionError("no line has these data")


def words(figure):
    """All text in the figure's SVG."""
    root = ElementTree.fromstring(svg_text(figure))
    return " ".join("".join(e.itertext()) for e in root.iter("{http://www.w3.org/2000/svg}text"))


def test_record_before_and_after(results):
    recording, prepared = results.recording, results.prepared
    before_u, after_u, before_y, after_y = draw_record(recording, prepared).axes
    rate, fitted = recording.sampling_rate, prepared.estimation.samples
    time_axis = np.arange(recording.samples) / rate
    assert_drawn(before_u, time_axis, recording.input)
    assert_drawn(before_y, time_axis, recording.output)
    assert_drawn(after_u, time_axis[:fitted], prepared.estimation.input)
    behind = (fitted + np.arange(prepared.validation.samples)) / rate
    assert_drawn(after_y, behind, prepared.validation.output)
    label = after_y.get_ylabel().replace("\n", " ")
    assert label == "second difference of Box-Cox transformed output"


def with_names(recording, name, unit):
    return replace(recording, output_name=name, output_unit=unit)


def test_units_are_shown_where_the_transforms_leave_them(results):
    prepared = results.prepared
    linear = replace(prepared.transforms, box_cox=None)
    named = PreparedData(
        with_names(prepared.estimation, "tip", "m/s²"),
        with_names(prepared.validation, "tip", "m/s²"),
        linear,
    )
    _, _, before, after = draw_record(with_names(results.recording, "tip", "m/s²"), named).axes
    assert before.get_ylabel() == "tip (m/s²)"
    assert after.get_ylabel().replace("\n", " ") == "second difference of tip (m/s²)"


def test_a_million_samples_draw_quickly_and_small(results):
    generator = np.random.default_rng(0)
    signals = generator.normal(size=(2, 1_000_000))
    whole = Recording(*signals, 50.0, "torque", "tip", "N m", "m/s²")
    parts = [
        replace(whole, input=whole.input[part], output=whole.output[part])
        for part in (slice(None, 800_000), slice(800_000, None))
    ]
    started = time.process_time()
    text = svg_text(draw_record(whole, PreparedData(*parts, results.prepared.transforms)))
    assert time.process_time() - started < 10
    assert len(text) < 600_000


def test_spectrum_with_band_peaks_and_truth(results):
    peaks = results.spectrum_summary.peaks
    figure = draw_spectrum(results.spectrum, peaks, "V", results.truth)
    (axes,) = figure.axes
    shown = results.spectrum.iloc[1:]
    assert_drawn(axes, shown["frequency_hz"], shown["density"])
    (band,) = axes.collections
    assert band.get_paths()[0].vertices[:, 1].max() == pytest.approx(shown["upper"].max())
    assert len(peaks) == 2
    assert list(lines(axes)["peaks"].get_xdata()) == [peak.frequency_hz for peak in peaks]
    marked = {line.get_xdata()[0] for line in axes.get_lines() if len(set(line.get_xdata())) == 1}
    assert marked >= {mode.frequency_hz for mode in results.truth.modes}
    for peak in peaks:
        assert f"{peak.frequency_hz:.4g} Hz" in words(figure)
    assert "((V)²/Hz)" in axes.get_ylabel()


def test_neighbouring_peaks_are_labelled_on_different_levels(results):
    peaks = [SpectralPeak(f, 1.0, 9.0, 0.5, 2.0) for f in (1.0, 1.5, 20.0)]
    texts = draw_spectrum(results.spectrum, peaks).axes[0].texts
    assert [text.get_text() for text in texts] == ["1 Hz", "1.5 Hz", "20 Hz"]
    heights = [text.xyann[1] for text in texts]
    assert heights[1] > heights[0] == heights[2]


def test_delay_has_one_line_for_each_delay(results):
    figure = draw_delay(results.candidates)
    tried = results.candidates[results.candidates["phase"] == "delay"]
    assert sorted(set(tried["nk"])) == [2, 3]
    for axes, column in zip(figure.axes, ("rss", "bic"), strict=True):
        assert len(axes.get_lines()) == 2
        for _, rows in tried.groupby("nk"):
            assert_drawn(axes, rows["na"], rows[column])
    assert words(figure).count("(selected)") == 1
    assert f"nk = {results.phases['delay'].orders.nk} (selected)" in words(figure)


def test_phases_mark_the_selection(results):
    figure = draw_phases(results.candidates)
    panels = np.array(figure.axes).reshape(2, 3)
    for column, (phase, order) in enumerate([("joint", "na"), ("nc", "nc"), ("nb", "nb")]):
        rows = results.candidates[results.candidates["phase"] == phase]
        selected = results.phases[phase].selected
        value = getattr(selected.orders, order)
        for row, criterion in enumerate(("rss", "bic")):
            assert_drawn(panels[row, column], rows[order], rows[criterion])
            assert_drawn(panels[row, column], [value], [getattr(selected.criteria, criterion)])
        assert f"k = {value}" in words(figure)


def test_the_selection_is_read_as_truth_values(results):
    """Text of a CSV would make every candidate selected."""
    assert results.candidates["selected"].dtype == bool
    assert results.candidates["selected"].sum() == 4


def test_residuals_show_every_lag_but_zero():
    lag = np.arange(40)
    r = np.where(lag == 0, 1.0, 0.03 * np.cos(lag))
    auto = pd.DataFrame({"lag": lag, "autocorrelation": r, "bound95": 0.02})
    cross = pd.DataFrame({"lag": lag - 20, "cross_correlation": 0.01, "bound95": 0.02})
    upper, lower = draw_residuals(auto, cross).axes
    inside, outside = (lines(upper)[label].get_xdata()[::3] for label in ("inside", "outside"))
    assert sorted([*inside, *outside]) == list(range(1, 40))
    assert set(outside) == set(lag[1:][np.abs(r[1:]) > 0.02])
    assert lines(lower)["inside"].get_xdata().size == 120
    assert upper.get_ylim()[1] < 0.05


def test_frequency_response_over_the_estimate(results):
    response, spectrum = results.frequency_response, results.spectrum
    figure = draw_frequency_response(response.iloc[::2], spectrum, "V/A", results.truth)
    gain, phase, coherence = figure.axes
    shown = response.iloc[2::2]
    assert_drawn(gain, shown["frequency_hz"], shown["gain"])
    f = spectrum["frequency_hz"][1:]
    assert_drawn(gain, f, spectrum["frequency_response_gain"][1:])
    assert_drawn(phase, *unwrapped_gaps(shown["frequency_hz"], shown["phase_deg"]))
    assert_drawn(coherence, f, spectrum["coherence"][1:])
    assert gain.get_ylabel() == "Gain (V/A)"
    upper = max(path.vertices[:, 1].max() for band in gain.collections for path in band.get_paths())
    assert upper == pytest.approx(shown["gain_upper"].max())


def test_phase_breaks_where_it_jumps():
    x, y = unwrapped_gaps(pd.Series([1.0, 2.0, 3.0]), pd.Series([170.0, 190.0, 200.0]))
    np.testing.assert_array_equal(x, [1, 1, 2, 3])
    np.testing.assert_array_equal(y, [170, np.nan, -170, -160])


def test_simulation_shows_one_scored_second(results):
    table = results.validation_tables.simulation.copy()
    computed = ["simulated", "predicted", "simulation_error", "prediction_error"]
    table.loc[:6, computed] = np.nan
    second, error, whole = draw_simulation(table, 100.0, "tip (V)").axes
    shown = table.iloc[7:108]
    assert_drawn(second, shown["time_s"], shown["output"])
    assert_drawn(second, shown["time_s"], shown["simulated"])
    assert_drawn(error, shown["time_s"], shown["prediction_error"])
    assert_drawn(error, shown["time_s"], shown["simulation_error"])
    assert_drawn(whole, table["time_s"], table["output"])
    assert {"measured", "simulated"} <= set(lines(second))


def test_poles_zeros_and_ellipses(results):
    model = results.model.model
    circle, damping = draw_poles_zeros(model, results.truth).axes
    for roots in (model.poles(), model.zeros(), model.noise_zeros()):
        assert_drawn(circle, roots.real, roots.imag)
    upper = np.array([mode.pole for mode in results.truth.modes])
    true = np.column_stack([upper, upper.conj()]).ravel()
    assert_drawn(circle, true.real, true.imag)
    # An ellipse for every pole and every zero of B.
    assert len(circle.patches) == model.poles().size + model.zeros().size
    modes = model.modes()
    frequencies = [mode.frequency_hz for mode in modes]
    assert_drawn(damping, frequencies, [100 * mode.damping_ratio for mode in modes])
    along, across = (bars.get_segments() for bars in damping.collections[:2])
    for mode, bar in zip(modes, along, strict=True):
        half = 1.96 * mode.frequency_se_hz
        np.testing.assert_allclose(bar[:, 0], mode.frequency_hz + np.array([-half, half]))
    for mode, bar in zip(modes, across, strict=True):
        half = 196 * mode.damping_se
        np.testing.assert_allclose(bar[:, 1], 100 * mode.damping_ratio + np.array([-half, half]))


def test_without_covariance_no_ellipse_and_no_interval_is_drawn(results):
    unknown = replace(results.model.model, covariance=None)
    circle, damping = draw_poles_zeros(unknown).axes
    assert len(circle.patches) == 0
    for bars in damping.collections[:2]:
        for bar in bars.get_segments():
            np.testing.assert_array_equal(bar[0], bar[1])


def test_stabilization_marks_each_status_and_the_selected_order():
    rows = [(4, 10.0, "new"), (5, 10.0, "frequency"), (6, 10.0, "stable"), (6, 30.0, "new")]
    poles = pd.DataFrame(rows, columns=["order", "frequency_hz", "status"])
    (axes,) = draw_stabilization(poles, 100.0, selected_order=5).axes
    drawn = lines(axes)
    assert list(drawn["new"].get_xdata()) == [10.0, 30.0]
    assert list(drawn["new"].get_ydata()) == [4, 6]
    assert list(drawn["stable in frequency"].get_ydata()) == [5]
    assert list(drawn["stable in frequency and damping"].get_ydata()) == [6]
    assert [text.get_text() for text in axes.texts] == ["selected"]
    assert axes.texts[0].xy[1] == 5


def test_the_first_screen_shows_the_simulation_and_the_gain_over_the_data(results):
    table, modes = results.validation_tables.simulation, results.model.modes
    (axes,) = draw_measured_and_simulated(table, modes, 100.0, "tip (V)").axes
    kept = shown_samples(modes, 100.0)
    shown = table[table["simulated"].notna()].iloc[:kept]
    for column in ("output", "simulated"):
        assert_drawn(axes, shown["time_s"], shown[column])
    (axes,) = draw_gain_and_data(results.frequency_response, results.spectrum, [5.0, 37.0]).axes
    # The response has more points than are drawn: its extremes are.
    drawn = lines(axes)["model G"].get_ydata()
    assert drawn.max() == pytest.approx(results.frequency_response["gain"].max())
    marked = [line.get_xdata()[0] for line in axes.get_lines() if len(line.get_xdata()) == 2]
    assert marked == [5.0, 37.0]
    thinned = gain_table(results)
    for source, whole in (
        ("model", results.frequency_response["gain"]),
        ("multitaper", results.spectrum["frequency_response_gain"]),
    ):
        own = thinned[thinned["source"] == source]["gain"]
        assert (own.min(), own.max()) == (whole.min(), whole.max())


def test_step_and_impulse_are_those_of_the_transfer_function(results):
    from scipy.signal import dlti, dstep

    model = results.model.model
    table = settling_part(results.time_response)
    numerator = np.zeros(max(len(model.delayed_b), len(model.a)))
    denominator = np.zeros_like(numerator)
    numerator[: len(model.delayed_b)] = model.delayed_b
    denominator[: len(model.a)] = model.a
    system = dlti(numerator, denominator, dt=1 / 100.0)
    times, (step,) = dstep(system, n=len(table))
    np.testing.assert_allclose(table["step"], step[:, 0], atol=1e-9)
    np.testing.assert_allclose(table["time_s"], times)
    impulse = table["impulse"].abs()
    assert impulse.iloc[-5:].max() < 0.02 * impulse.max()
    for axes, column in zip(draw_step_and_impulse(table).axes, ("step", "impulse"), strict=True):
        assert_drawn(axes, table["time_s"], table[column])
        band = axes.collections[0].get_paths()[0].vertices[:, 1]
        assert band.max() == pytest.approx(table[f"{column}_upper"].max())


@pytest.fixture(scope="module")
def of_noise_alone(results):
    """The same results as if the model had no input, whose noise filter is left."""
    record = results.model
    plain = replace(
        record, orders=replace(record.orders, nb=0, nk=0, structure="arma"), b=np.empty(0)
    )
    response, in_time = results.frequency_response.copy(), results.time_response.copy()
    response[["gain", "gain_lower", "gain_upper", "phase_deg"]] = np.nan
    in_time[["step", "impulse"]] = np.nan
    tables = results.validation_tables
    simulation = tables.simulation.assign(
        simulated=np.nan, simulation_error=np.nan, recorded_simulated=np.nan
    )
    return replace(
        results,
        model=replace(plain, covariance_factor=None),
        settings=replace(
            results.settings, order_grid=replace(results.settings.order_grid, structure="arma")
        ),
        phases={name: results.phases[name] for name in ("joint", "nc")},
        spectrum=results.spectrum[["frequency_hz", "density", "lower", "upper"]],
        frequency_response=response,
        time_response=in_time,
        validation_tables=replace(tables, simulation=simulation),
    )


def test_without_an_input_the_noise_filter_and_the_prediction_are_drawn(of_noise_alone):
    results = of_noise_alone
    shown = {figure.name: figure for figure in REPORT_FIGURES if figure.applies(results)}
    assert set(FIGURES) - set(shown) == {"nyquist", "delay"}
    noise = results.frequency_response["noise_gain"]
    gain = shown["gain"].table(results)
    assert set(gain["source"]) == {"noise filter"}
    assert gain["gain"].max() == noise.max()
    drawn = lines(shown["gain"].draw(results).axes[0])
    assert drawn["noise filter H"].get_ydata().max() == noise.max()
    assert "multitaper" not in drawn
    first = shown["measured_and_simulated"].table(results)
    assert list(first.columns) == ["time_s", "output", "predicted"]
    assert first["predicted"].notna().all()
    (axes,) = shown["step_and_impulse"].draw(results).axes
    part = settling_part(results.time_response)
    assert_drawn(axes, part["time_s"], part["noise_impulse"])


def test_what_a_page_draws_without_an_input_is_in_its_tables(of_noise_alone):
    for figure in REPORT_FIGURES:
        if not figure.applies(of_noise_alone):
            continue
        table = figure.table(of_noise_alone)
        for panel in figure.panels(of_noise_alone):
            for curve in panel.curves:
                if curve.source:
                    continue
                rows = table
                if curve.where and curve.where[1] != "not 0":
                    rows = table[table[curve.where[0]] == curve.where[1]]
                assert {panel.x, curve.column, *curve.band} <= set(table.columns), figure.name
                # Of the status of a pole there may be no row.
                assert figure.name == "stabilization" or rows[curve.column].notna().any()


def test_the_nyquist_diagram_shows_the_frequency_response_in_the_complex_plane(results):
    table = results.frequency_response
    response = results.model.model.frequency_response(table["frequency_hz"])
    parts = complex_plane(table["gain"], table["phase_deg"])
    np.testing.assert_allclose(parts[:, 0] + 1j * parts[:, 1], response, rtol=1e-6, atol=1e-9)
    (axes,) = draw_nyquist(table, results.spectrum, "V/A").axes
    assert_drawn(axes, parts[:, 0], parts[:, 1])
    assert axes.get_xlabel() == "Real part of G (V/A)"


def test_the_level_of_white_noise_goes_through_the_residual_spectrum(results):
    table = residual_spectrum_table(results)
    step = table["frequency_hz"].iloc[1]
    errors = results.validation_tables.simulation["prediction_error"]
    assert table["density"].sum() * step == pytest.approx(errors.var(ddof=0), rel=1e-6)
    assert table["density"].mean() == pytest.approx(table["white_level"].iloc[0], rel=0.01)
    (axes,) = draw_residual_spectrum(table, "V").axes
    assert_drawn(axes, table["frequency_hz"][1:], table["white_level"][1:])
    assert "too few residuals" in words(draw_residual_spectrum(table.iloc[:0]))


def test_the_simulation_is_drawn_in_recorded_units(results):
    table = results.validation_tables.simulation
    (axes,) = draw_simulation_as_recorded(table, "tip (V)").axes
    for column in ("recorded_output", "recorded_predicted", "recorded_simulated"):
        assert_drawn(axes, table["time_s"], table[column])


def test_panels_name_columns_of_their_figures_tables(results):
    """The page draws a panel from these columns of the figure's own table or of a named one."""
    tables = {figure.name: figure.table(results) for figure in REPORT_FIGURES}
    drawn = 0
    for figure in REPORT_FIGURES:
        for panel in figure.panels(results):
            for curve in panel.curves:
                table = tables[curve.source or figure.name]
                assert {panel.x, curve.column, *curve.band, *curve.where[:1]} <= set(table)
                if curve.where and curve.where[1] != "not 0":
                    assert curve.where[1] in set(table[curve.where[0]])
                drawn += 1
    assert drawn > 30


def test_convergence_ends_where_the_search_did(results):
    history = results.selected.diagnostics.convergence
    figure = draw_convergence(history)
    evaluations, best = zip(*history, strict=True)
    assert_drawn(figure.axes[0], evaluations, best)
    assert f"{best[-1]:.6g}" in words(figure)


def test_the_last_digits_of_a_search_are_not_enlarged():
    low, high = draw_convergence([(1000, 3.5903), (2000, 3.5902)]).axes[0].get_ylim()
    assert high - low == pytest.approx(0.01 * 3.5902)
    assert low < 3.5902 < 3.5903 < high


def test_what_is_missing_is_said(results):
    of_nb = results.candidates[results.candidates["phase"] == "nb"]
    assert "is empty" in words(draw_convergence([]))
    assert "no candidates of the delay search" in words(draw_delay(of_nb))
    assert "Not searched" in words(draw_phases(of_nb))
    nothing = pd.DataFrame(columns=["order", "frequency_hz", "status"])
    assert "No candidate" in words(draw_stabilization(nothing, 1.0))


def test_hostile_names_are_drawn_as_text(results):
    prepared = results.prepared
    named = PreparedData(
        with_names(prepared.estimation, HOSTILE, "V"), prepared.validation, prepared.transforms
    )
    simulation = results.validation_tables.simulation
    for figure in (
        draw_record(with_names(results.recording, HOSTILE, "V"), named),
        draw_simulation(simulation, 100.0, HOSTILE),
    ):
        assert "<script" not in svg_text(figure)
        # A long label is folded over several lines.
        assert "".join(HOSTILE.split())[:30] in "".join(words(figure).split())
        assert "$x^2$" in words(figure)


PROGRAM = """
import sys
from evopem.figures.convergence import draw_convergence
from evopem.figures.style import svg_text
sys.stdout.write(svg_text(draw_convergence([(1, 3.0), (5, 2.0), (9, 1.7)])))
"""


def test_equal_data_give_equal_bytes_in_other_processes():
    texts = {
        subprocess.run(
            [sys.executable, "-c", PROGRAM],
            env={"PYTHONHASHSEED": seed, "PYTHONPATH": ":".join(sys.path)},
            check=True,
            capture_output=True,
            text=True,
        ).stdout
        for seed in ("1", "2")
    }
    assert len(texts) == 1
    assert "<svg" in texts.pop()


def test_the_settings_of_matplotlib_are_restored():
    import matplotlib as mpl

    before = dict(mpl.rcParams)
    draw_convergence([(1, 3.0), (5, 2.0)])
    assert dict(mpl.rcParams) == before


def test_the_figures_are_those_of_the_layout(results, tmp_path):
    assert tuple(figure.name for figure in REPORT_FIGURES) == FIGURES
    files = draw_all(results, tmp_path)
    assert [file.relative_to(tmp_path).as_posix() for file in files] == [
        f"{name}.svg" for name in FIGURES
    ]
    for file in files:
        assert ElementTree.fromstring(file.read_text(encoding="utf-8")).tag.endswith("svg")


def test_the_data_of_every_figure_are_files_of_the_results(identified):
    for figure in REPORT_FIGURES:
        for file in figure.data_files:
            assert (Path(identified.files.folder) / file).exists()


def test_the_archive_of_all_results_has_the_same_captions():
    folder = Path(__file__).parents[2] / "workflow" / "report" / "figures"
    captions = {file.stem: file.read_text(encoding="utf-8") for file in folder.iterdir()}
    assert captions == {
        figure.name: f"{{{{ snakemake.wildcards.dataset }}}}: {figure.caption}\n"
        for figure in REPORT_FIGURES
    }
