"""Figures hold the data they are given, whatever the names, and the same bytes each time."""

import subprocess
import sys
import time
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
import pandas as pd
import pytest
from evopem.figures.order_selection import draw_convergence, draw_delay, draw_phases
from evopem.figures.residuals import draw_residuals

from evopem.figures import FIGURE_NAMES, FIGURES
from evopem.figures.frequency_domain import (
    draw_frequency_response,
    draw_spectrum,
    unwrapped_gaps,
)
from evopem.figures.pole_zero_map import (
    draw_poles_zeros,
    draw_stabilization,
    ellipse_radii,
    root_spread,
    stabilization,
)
from evopem.figures.style import svg_text
from evopem.figures.time_domain import draw_record, draw_simulation
from evopem.signals.preparation import PreparedData, Transforms
from evopem.signals.recording import Recording

HOSTILE = """<script>alert("1")</script> $x^2$ & 'q' \\frac"""


def lines(axes):
    return {line.get_label(): line for line in axes.get_lines()}


def assert_drawn(axes, x, y):
    """Some line on the axes goes through exactly these points."""
    for line in axes.get_lines():
        if len(line.get_xdata()) == len(x):
            drawn = np.column_stack([line.get_xdata(), line.get_ydata()]).astype(float)
            if np.allclose(drawn, np.column_stack([x, y]), equal_nan=True):
                return
    raise AssertionError("no line holds these data")


def words(figure):
    """All text in the figure's SVG."""
    root = ElementTree.fromstring(svg_text(figure))
    return " ".join("".join(e.itertext()) for e in root.iter("{http://www.w3.org/2000/svg}text"))


def recording(samples, name="tip"):
    rng = np.random.default_rng(0)
    return Recording(
        rng.normal(size=samples), rng.normal(size=samples), 50.0, "torque", name, "N m", "m/s²"
    )


def preparation(samples, difference=0, name="tip"):
    whole = recording(samples, name)
    cut = samples // 2
    parts = [
        Recording(whole.input[s], whole.output[s], 50.0, "torque", name, "N m", "m/s²")
        for s in (slice(None, cut), slice(cut, None))
    ]
    transforms = Transforms(50.0, None, None, 0.0, difference, (), 0, (), 0.0, 0.0, 0)
    return whole, PreparedData(*parts, True, transforms)


@pytest.fixture
def candidates():
    rng = np.random.default_rng(1)
    rows = [("delay", k, k, k, nk, k == 7 and nk == 2) for k in (6, 7, 8) for nk in (0, 1, 2)]
    rows += [("common", k, k, k, 2, k == 8) for k in range(6, 12)]
    rows += [("c", 8, 8, k, 2, k == 5) for k in range(2, 9)]
    rows += [("b", 8, k, 5, 2, k == 4) for k in range(2, 9)]
    table = pd.DataFrame(rows, columns=["phase", "na", "nb", "nc", "nk", "selected"])
    return table.assign(
        rss=rng.uniform(1, 2, len(table)), bic=rng.normal(-5, 0.1, len(table)), evaluations=100
    )


@pytest.fixture
def spectrum():
    f = np.linspace(0, 25, 201)
    density = 1 / (0.1 + (f - 7) ** 2)
    return pd.DataFrame(
        {
            "frequency_hz": f,
            "density": density,
            "lower": 0.6 * density,
            "upper": 1.8 * density,
            "frequency_response_gain": np.sqrt(density),
            "frequency_response_phase_deg": 170 * np.sin(f),
            "coherence": np.full(f.size, 0.9),
        }
    )


@pytest.fixture
def model():
    a = np.real(np.poly([0.95 * np.exp(0.6j), 0.95 * np.exp(-0.6j), 0.3]))
    return {
        "a": a.tolist(),
        "b": [1.0, -0.4],
        "c": [1.0, 0.2],
        "sampling_rate": 50.0,
        "covariance": (1e-5 * np.eye(6)).tolist(),
        "modes": [
            {
                "frequency_hz": 4.8,
                "damping_percent": 8.5,
                "frequency_se_hz": 0.1,
                "damping_se_percent": 1.0,
            }
        ],
    }


TRUTH = {"modes": [{"frequency_hz": 5.0, "damping_percent": 8.0}]}


def test_record_before_and_after():
    whole, prepared = preparation(300, difference=2)
    figure = draw_record(whole, prepared)
    before_u, after_u, before_y, after_y = figure.axes
    time_axis = np.arange(300) / 50.0
    assert_drawn(before_u, time_axis, whole.input)
    assert_drawn(before_y, time_axis, whole.output)
    assert_drawn(after_u, time_axis[:150], prepared.estimation.input)
    assert_drawn(after_y, time_axis[150:], prepared.validation.output)
    assert "second difference of" in after_y.get_ylabel().replace("\n", " ")
    assert "(m/s²)" in before_y.get_ylabel()


def test_a_million_samples_draw_quickly_and_small():
    started = time.process_time()
    text = svg_text(draw_record(*preparation(1_000_000)))
    assert time.process_time() - started < 10
    assert len(text) < 600_000


def test_spectrum_with_band_peaks_and_truth(spectrum):
    summary = {"peaks": [{"frequency_hz": 7.0, "density": 10.0}]}
    figure = draw_spectrum(spectrum, summary, "V", TRUTH)
    (axes,) = figure.axes
    shown = spectrum.iloc[1:]
    assert_drawn(axes, shown["frequency_hz"], shown["density"])
    (band,) = axes.collections
    assert band.get_paths()[0].vertices[:, 1].max() == pytest.approx(shown["upper"].max())
    assert lines(axes)["peaks"].get_xdata() == [7.0]
    assert list(lines(axes)["true modes"].get_xdata()) == [5.0, 5.0]
    assert "7 Hz" in words(figure)
    assert "((V)²/Hz)" in axes.get_ylabel()


def test_delay_has_one_line_for_each_delay(candidates):
    figure = draw_delay(candidates)
    for axes, column in zip(figure.axes, ("rss", "bic"), strict=True):
        assert len(axes.get_lines()) == 3
        for nk in range(3):
            rows = candidates[(candidates["phase"] == "delay") & (candidates["nk"] == nk)]
            assert_drawn(axes, rows["na"], rows[column])
    assert "nk = 2 (chosen)" in words(figure)


def test_phases_mark_the_choice(candidates):
    figure = draw_phases(candidates)
    panels = np.array(figure.axes).reshape(2, 3)
    for column, (phase, order, chosen) in enumerate(
        [("common", "na", 8), ("c", "nc", 5), ("b", "nb", 4)]
    ):
        rows = candidates[candidates["phase"] == phase]
        for row, criterion in enumerate(("rss", "bic")):
            assert_drawn(panels[row, column], rows[order], rows[criterion])
            value = rows.loc[rows["selected"], criterion].iloc[0]
            assert_drawn(panels[row, column], [chosen], [value])
        assert f"k = {chosen}" in words(figure)


def test_choices_read_from_csv_as_text_are_marked(candidates):
    texts = candidates.assign(selected=candidates["selected"].map({True: "True", False: "False"}))
    assert svg_text(draw_phases(texts)) == svg_text(draw_phases(candidates))


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


def test_frequency_response_over_the_estimate(spectrum):
    f = spectrum["frequency_hz"]
    response = pd.DataFrame(
        {
            "frequency_hz": f,
            "gain": 1 + f,
            "gain_lower": 0.9 + f,
            "gain_upper": 1.1 + f,
            "phase_deg": -7 * f,
        }
    )
    gain, phase, coherence = draw_frequency_response(response, spectrum, "V/A", TRUTH).axes
    assert_drawn(gain, f[1:], 1 + f[1:])
    assert_drawn(gain, f[1:], spectrum["frequency_response_gain"][1:])
    assert_drawn(phase, f[1:], -7 * f[1:])
    assert_drawn(coherence, f[1:], spectrum["coherence"][1:])
    assert gain.get_ylabel() == "Gain (V/A)"


def test_phase_breaks_where_it_jumps():
    x, y = unwrapped_gaps(pd.Series([1.0, 2.0, 3.0]), pd.Series([170.0, 190.0, 200.0]))
    np.testing.assert_array_equal(x, [1, 1, 2, 3])
    np.testing.assert_array_equal(y, [170, np.nan, -170, -160])


def simulation_table(samples=500):
    t = np.arange(samples) / 100.0
    y = np.sin(9 * t)
    table = pd.DataFrame({"time_s": t, "output": y, "simulated": 0.9 * y, "predicted": 0.99 * y})
    table["simulation_error"] = y - table["simulated"]
    table["prediction_error"] = y - table["predicted"]
    table.loc[:6, ["simulated", "predicted", "simulation_error", "prediction_error"]] = np.nan
    return table


def test_simulation_shows_one_scored_second():
    table = simulation_table()
    second, error, whole = draw_simulation(table, 100.0, "tip (V)").axes
    shown = table.iloc[7:108]
    assert_drawn(second, shown["time_s"], shown["output"])
    assert_drawn(second, shown["time_s"], shown["simulated"])
    assert_drawn(error, shown["time_s"], shown["prediction_error"])
    assert_drawn(error, shown["time_s"], shown["simulation_error"])
    assert_drawn(whole, table["time_s"], table["output"])
    assert {"measured", "simulated"} <= set(lines(second))


def test_poles_zeros_and_ellipses(model):
    circle, damping = draw_poles_zeros(model, TRUTH).axes
    poles = np.roots(model["a"])
    assert_drawn(circle, poles.real, poles.imag)
    assert_drawn(circle, [0.4], [0.0])
    assert_drawn(circle, [-0.2], [0.0])
    true = 2 * np.pi * 5.0 / 50.0 * np.array([-0.08, np.sqrt(1 - 0.08**2)])
    z = np.exp(complex(*true))
    assert_drawn(circle, [z.real, z.real], [z.imag, -z.imag])
    # An ellipse for each of three poles and for the zero of B.
    assert len(circle.patches) == 4
    assert_drawn(damping, [4.8], [8.5])


def test_ellipses_hold_as_many_estimates_as_they_say(model):
    rng = np.random.default_rng(3)
    size = len(model["a"]) + len(model["b"]) + len(model["c"]) - 2
    b, half = [1.0, -1.0, 0.5], 0.01  # zeros 0.5 ± 0.5i
    model |= {"b": b, "covariance": np.diag([half**2] * (size + 3 - len(model["b"]))).tolist()}
    zero = 0.5 + 0.5j
    spread = root_spread(model, "b", zero)
    drawn = b + half * rng.normal(size=(4000, 3))
    offsets = np.array([max(np.roots(p), key=lambda root: root.imag) - zero for p in drawn])
    points = np.vstack([offsets.real, offsets.imag])
    radii = np.sqrt(np.sum(points * np.linalg.solve(spread, points), axis=0))
    # 95 % within √5.99, up to three standard errors of 4000 draws.
    assert np.mean(radii < np.sqrt(5.9915)) == pytest.approx(0.95, abs=0.0104)
    # The half axes are the square roots of the eigenvalues, stretched as much.
    expected = np.sqrt(5.9915 * np.linalg.eigvalsh(spread))
    np.testing.assert_allclose(ellipse_radii(zero, spread), expected, rtol=1e-4)


def test_without_covariance_no_ellipse_is_invented(model):
    del model["covariance"]
    assert len(draw_poles_zeros(model).axes[0].patches) == 0


def denominators(frequencies, damping):
    poles = []
    for f in frequencies:
        w = 2 * np.pi * f / 100
        z = np.exp(w * complex(-damping, np.sqrt(1 - damping**2)))
        poles += [z, z.conjugate()]
    return np.real(np.poly(poles)).tolist()


def test_stabilization_by_hand():
    records = [
        {"na": 2, "a": denominators([10.0], 0.05), "bic": -1.0},
        {"na": 2, "a": denominators([30.0], 0.05), "bic": 0.0},  # the worse of two
        {"na": 4, "a": denominators([10.05, 20.0], 0.052), "bic": -1.0},
        {"na": 6, "a": denominators([10.05, 20.1, 40.0], 0.09), "bic": -1.0},
    ]
    table = stabilization(records, 100.0).sort_values(["order", "frequency_hz"])
    assert table["status"].tolist() == ["new", "stable", "new", "frequency", "frequency", "new"]
    np.testing.assert_allclose(table["frequency_hz"], [10, 10.05, 20, 10.05, 20.1, 40], rtol=1e-6)
    (axes,) = draw_stabilization(table, 100.0, chosen_order=4).axes
    assert_drawn(axes, [10.05], [4])


def test_convergence_ends_where_the_search_did():
    figure = draw_convergence({"convergence": [[1, 9.0], [50, 5.0], [90, 4.5]]})
    assert_drawn(figure.axes[0], [1, 50, 90], [9.0, 5.0, 4.5])
    assert "4.5" in words(figure)


def test_the_last_digits_of_a_search_are_not_blown_up():
    history = [[1000, 3.5903], [2000, 3.5902]]
    low, high = draw_convergence({"convergence": history}).axes[0].get_ylim()
    assert high - low == pytest.approx(0.01 * 3.5902)
    assert low < 3.5902 < 3.5903 < high


def test_neighbouring_peaks_are_named_on_different_levels(spectrum):
    peaks = [{"frequency_hz": f, "density": 1.0, "prominence_db": 9.0} for f in (1.0, 1.5, 20.0)]
    texts = draw_spectrum(spectrum, {"peaks": peaks}).axes[0].texts
    assert [text.get_text() for text in texts] == ["1 Hz", "1.5 Hz", "20 Hz"]
    heights = [text.xyann[1] for text in texts]
    assert heights[1] > heights[0] == heights[2]


def test_what_is_missing_is_said(candidates):
    assert "no history" in words(draw_convergence(None))
    assert "No delay search" in words(draw_delay(candidates[candidates["phase"] == "b"]))
    assert "Not searched" in words(draw_phases(candidates[candidates["phase"] == "b"]))
    assert "No candidate" in words(draw_stabilization(stabilization([], 1.0), 1.0))


def test_hostile_names_are_drawn_as_text():
    _, prepared = preparation(200, name=HOSTILE)
    for figure in (
        draw_record(recording(200, HOSTILE), prepared),
        draw_simulation(simulation_table(), 100.0, HOSTILE),
    ):
        assert "<script" not in svg_text(figure)
        # A long label is folded over several lines.
        assert "".join(HOSTILE.split())[:30] in "".join(words(figure).split())
        assert "$x^2$" in words(figure)


PROGRAM = """
import sys
import pandas as pd
from evopem.figures.order_selection import draw_convergence
from evopem.figures.style import svg_text
sys.stdout.write(svg_text(draw_convergence({"convergence": [[1, 3.0], [5, 2.0], [9, 1.7]]})))
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


def test_style_leaves_no_trace():
    import matplotlib as mpl

    before = dict(mpl.rcParams)
    draw_convergence({"convergence": [[1, 3.0], [5, 2.0]]})
    assert dict(mpl.rcParams) == before


def test_every_figure_has_a_name_of_its_own():
    assert len(set(FIGURE_NAMES)) == len(FIGURE_NAMES) == 10


def test_the_archive_of_all_results_has_the_same_captions():
    folder = Path(__file__).parents[2] / "workflow" / "report" / "figures"
    captions = {file.stem: file.read_text(encoding="utf-8") for file in folder.iterdir()}
    assert captions == {
        entry.name: f"{{{{ snakemake.wildcards.dataset }}}}: {entry.caption}\n" for entry in FIGURES
    }
