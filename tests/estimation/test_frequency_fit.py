"""Models of frequency responses: against closed forms, simulations of known noise, and time."""

from __future__ import annotations

import json
from contextlib import redirect_stdout
from dataclasses import replace
from io import StringIO
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
import yaml
from scipy.io import loadmat

import evopem
from evopem import FrequencyResponses, fit_responses
from evopem.config.channels import ChannelSettings
from evopem.config.defaults import complete, read_settings
from evopem.errors import InputError
from evopem.estimation.model_record import ModelRecord
from evopem.estimation.search import frequency_problem
from evopem.estimation.search.frequency_problem import FrequencyProblem
from evopem.files.json_form import load
from evopem.pipeline.frequency_responses import identify_responses
from evopem.results.layout import DatasetFiles
from evopem.signals.readers.frequency_responses import read_responses, variances_of
from evopem.terminal.command import main
from evopem.validation.frequency_responses import validate_responses

FREQUENCIES = np.linspace(1.0, 50.0, 150)
HERTZ, DAMPING = np.array([12.0, 31.0]), np.array([0.02, 0.015])
SHAPES = np.array([[1.0, 0.6, -0.2], [-0.7, 1.0, 0.4]])
DRIVES = np.array([[1.0, 0.5], [0.8, -0.3]])


def responses_at(frequencies, outputs=1, inputs=1):
    """Of two modes in continuous time, (F, outputs, inputs)."""
    omega, s = 2.0 * np.pi * HERTZ, 2j * np.pi * frequencies[:, None, None]
    return sum(
        np.outer(SHAPES[k, :outputs], DRIVES[k, :inputs])
        * omega[k] ** 2
        / (s**2 + 2.0 * DAMPING[k] * omega[k] * s + omega[k] ** 2)
        for k in range(2)
    )


def noise(shape, generator):
    """Complex, of variance 1."""
    return (generator.standard_normal(shape) + 1j * generator.standard_normal(shape)) / np.sqrt(2.0)


def noisy(outputs=1, inputs=1, deviation=0.4, seed=0, known=True):
    exact = responses_at(FREQUENCIES, outputs, inputs)
    values = exact + deviation * noise(exact.shape, np.random.default_rng(seed))
    variances = np.full(exact.shape, deviation**2) if known else None
    return FrequencyResponses(FREQUENCIES, values, variances)


@pytest.mark.parametrize(("outputs", "inputs"), [(1, 1), (3, 1), (1, 2), (3, 2)])
def test_exact_responses_give_the_exact_modes_and_shapes(outputs, inputs):
    exact = FrequencyResponses(FREQUENCIES, responses_at(FREQUENCIES, outputs, inputs))
    fit = fit_responses(exact, modes=(2, 2))
    modes = fit.model.modes()
    np.testing.assert_allclose([mode.frequency_hz for mode in modes], HERTZ, rtol=1e-8)
    np.testing.assert_allclose([mode.damping_ratio for mode in modes], DAMPING, rtol=1e-6)
    for mode, shape in zip(modes, SHAPES[:, :outputs], strict=True):
        expected = shape / shape[np.argmax(np.abs(shape))]
        np.testing.assert_allclose(mode.shape, expected, atol=1e-6)
    between = np.linspace(2.0, 49.0, 77)
    expected = responses_at(between, outputs, inputs)
    np.testing.assert_allclose(fit.response(between), expected, atol=1e-6)


def test_the_model_of_sampled_signals_is_that_of_the_responses():
    """In discrete time the model itself has them; in continuous time its equivalent has not."""
    rate, angle = 120.0, 2.0 * np.pi * HERTZ[0] / 120.0
    pole = 0.97 * np.exp(1j * angle)
    truth = evopem.PolynomialModel(
        [1.0], [0.0, 0.4, 0.1], F=[1.0, -2.0 * pole.real, abs(pole) ** 2], sampling_rate=rate
    )
    values = truth.frequency_response(FREQUENCIES)
    given = FrequencyResponses(FREQUENCIES, values, sampling_rate=rate)
    fit = fit_responses(given, modes=(1, 1))
    between = np.linspace(0.5, 59.0, 50)
    expected = truth.frequency_response(between)
    np.testing.assert_allclose(fit.model.frequency_response(between), expected, atol=1e-8)
    np.testing.assert_allclose(fit.response(between), expected, atol=1e-8)
    with pytest.raises(InputError, match="not below half the sampling rate"):
        replace(given, sampling_rate=90.0)


def test_the_derivatives_are_exact():
    given = noisy(3, 2)
    fit = fit_responses(given, modes=(2, 2))
    moved = fit.flat + 0.01 * np.random.default_rng(1).standard_normal(fit.flat.size)

    def squares(parameters):
        return replace(fit, **fit.split(parameters)).equations()[0]

    gradient = replace(fit, **fit.split(moved)).equations()[1]
    steps = 1e-6 * np.eye(moved.size)
    differences = [0.25e6 * (squares(moved + e) - squares(moved - e)) for e in steps]
    np.testing.assert_allclose(gradient, differences, rtol=1e-4, atol=1e-4 * abs(gradient).max())


def test_poles_alone_descend_along_the_exact_gradient():
    given = noisy(3)
    p = 2j * np.pi * FREQUENCIES / 300.0
    problem = FrequencyProblem(p, given.values[:, :, 0], np.ones((150, 3)), 2)
    point = np.log(np.array([0.24, 0.66, 0.03, 0.02]))
    _, gradient, _ = problem.equations(point)
    squares = [
        [float(np.sum(problem.solved(point + sign * e)[0] ** 2)) for sign in (1, -1)]
        for e in 1e-6 * np.eye(4)
    ]
    differences = [0.25e6 * (above - below) for above, below in squares]
    np.testing.assert_allclose(gradient, differences, rtol=1e-4)


@pytest.mark.parametrize("known", [True, False])
def test_standard_errors_cover_the_truth(known, monkeypatch):
    """40 responses: of 160 intervals of 95 % 8 miss on average, and more than 18 once in 2000."""
    # Descents from two starts find the optimum of two clear modes.
    monkeypatch.setattr(frequency_problem, "RESTARTS", 2)
    monkeypatch.setattr(frequency_problem, "HOPPING", 0)
    truth, missed = np.column_stack([HERTZ, DAMPING]), 0
    for seed in range(40):
        modes = fit_responses(noisy(seed=seed, known=known), modes=(2, 2)).model.modes()
        found = np.array([(mode.frequency_hz, mode.damping_ratio) for mode in modes])
        errors = np.array([(mode.frequency_se_hz, mode.damping_se) for mode in modes])
        missed += int(np.sum(np.abs(found - truth) > 1.96 * errors))
    assert 1 <= missed <= 18


def test_a_mode_made_of_errors_that_a_window_correlates_is_not_trusted(monkeypatch):
    """Of one mode too many, which has a known frequency and damping in most of the responses."""
    monkeypatch.setattr(frequency_problem, "RESTARTS", 2)
    monkeypatch.setattr(frequency_problem, "HOPPING", 0)
    exact, known = responses_at(FREQUENCIES), 0
    for seed in range(6):
        white = noise(len(exact) + 2, np.random.default_rng(seed))
        smooth = np.convolve(white, [0.5, 1.0, 0.5], "valid")[:, None, None] / np.sqrt(1.5)
        given = FrequencyResponses(FREQUENCIES, exact + 0.4 * smooth, np.full(exact.shape, 0.16))
        fit = fit_responses(given, modes=(3, 3))
        judged = validate_responses(fit, fit.model.modes(), 3).modes
        np.testing.assert_allclose([mode.frequency_hz for mode in judged.trusted], HERTZ, rtol=1e-2)
        known += any(len(mode.doubts) == 1 for mode in judged.modes)
    assert known >= 3


def test_the_number_of_modes_and_the_size_of_the_errors_are_found():
    fit = fit_responses(noisy(2, seed=3), modes=(1, 4))
    assert fit.sections == 2
    squares = float(np.sum(np.abs(fit.errors) ** 2))
    freedom = 2 * fit.errors.size - fit.parameters
    assert abs(squares / freedom - 1.0) < 4.0 * np.sqrt(2.0 / freedom)
    unknown = fit_responses(noisy(2, seed=3, known=False), modes=(2, 2))
    assert unknown.variance_factor == pytest.approx(1.0, abs=0.05)


def test_frequency_and_time_tell_the_same_of_one_recording():
    """Two periods of a multisine: responses of the second one beside the record in time."""
    rate, count, generator = 120.0, 600, np.random.default_rng(5)
    pole = 0.97 * np.exp(2j * np.pi * HERTZ[0] / rate)
    truth = evopem.PolynomialModel(
        [1.0], [0.0, 0.4, 0.1], F=[1.0, -2.0 * pole.real, abs(pole) ** 2], sampling_rate=rate
    )
    lines = np.arange(1, count // 2)
    angles = generator.uniform(0.0, 2.0 * np.pi, lines.size)
    period = np.fft.irfft(np.r_[0.0, np.exp(1j * angles), 0.0], count) * np.sqrt(count)
    u = np.tile(period, 2)
    y = np.asarray(truth.simulate(u)).ravel() + 0.3 * generator.standard_normal(2 * count)
    spectra = [np.fft.rfft(signal[count:])[lines] for signal in (u, y)]
    variances = 0.3**2 * count / np.abs(spectra[0]) ** 2
    responses = FrequencyResponses(
        lines * rate / count, spectra[1] / spectra[0], variances, sampling_rate=rate
    )
    (of_lines,) = fit_responses(responses, modes=(1, 1)).model.modes()
    settings = evopem.SearchSettings(objective="quadratic")
    in_time = evopem.estimate(
        u, y, {"nb": 3, "nf": 2, "nk": 0}, rate, structure="oe", settings=settings
    )
    (of_samples,) = in_time.model.modes()
    for name, error in (("frequency_hz", "frequency_se_hz"), ("damping_ratio", "damping_se")):
        both = [getattr(mode, name) for mode in (of_lines, of_samples)]
        assert abs(both[0] - both[1]) < 3.0 * getattr(of_lines, error)
        ratio = getattr(of_lines, error) / getattr(of_samples, error)
        assert 1.0 < ratio < 2.0  # one period of two: √2


# Files


def write_uff(path, values, coherence=None):
    import pyuff

    file = pyuff.UFF(str(path))
    for kind, data in ((4, values), (6, coherence)):
        for k, j in np.ndindex(values.shape[1:]):
            if data is not None:
                dataset = pyuff.prepare_58(
                    func_type=kind, rsp_node=k + 1, rsp_dir=3, ref_node=j + 1, ref_dir=-1,
                    binary=0, id1="response", data=data[:, k, j], x=FREQUENCIES,
                    abscissa_spacing=0, abscissa_spec_data_type=18, ordinate_spec_data_type=12,
                    orddenom_spec_data_type=13, ordinate_axis_units_lab="m/s^2",
                )  # fmt: skip
                file.write_sets(dataset, mode="add")


def asked(inputs, outputs, **others):
    return ChannelSettings(inputs, outputs, **others)


def test_responses_and_coherences_of_a_universal_file(tmp_path):
    path, values = tmp_path / "beam.uff", responses_at(FREQUENCIES, 3, 2)
    coherence = np.full(values.shape, 0.9)
    write_uff(path, values, coherence)
    read = read_responses(path, asked(("*",), ("*",), frequency="abscissa"))
    np.testing.assert_allclose(read.values, values, rtol=1e-5, atol=1e-5)
    np.testing.assert_allclose(read.frequencies, FREQUENCIES, rtol=1e-5)
    assert read.output_names == ("1:Z+", "2:Z+", "3:Z+")
    assert (read.input_names, read.output_units[0]) == (("1:X-", "2:X-"), "m/s^2")
    np.testing.assert_allclose(read.variances, variances_of(values, coherence), rtol=1e-3)
    assert not read.are_absolute
    one = read_responses(path, asked(("2:X-",), ("3:Z+", "1:Z+"), frequency="abscissa"))
    np.testing.assert_allclose(one.values[:, :, 0], values[:, [2, 0], 1], rtol=1e-5, atol=1e-5)
    with pytest.raises(InputError, match=r"no frequency response belongs to 9:Z\+; choose among 1"):
        read_responses(path, asked(("*",), ("9:Z+",), frequency="abscissa"))


@pytest.mark.parametrize("form", ["parts", "polar", "bode", "spelled", "milli", "micro", "complex"])
def test_responses_of_tables(tmp_path, form):
    values = responses_at(FREQUENCIES, 2)[:, :, 0]
    variances = 0.01 + 0.0 * FREQUENCIES
    path = tmp_path / ("frf.npz" if form == "complex" else "frf.csv")
    if form == "complex":
        np.savez(path, f=FREQUENCIES, tip=values[:, 0], mid=values[:, 1])
    else:
        columns = {"f [Hz]": FREQUENCIES}
        for name, response in zip(("tip", "mid"), values.T, strict=True):
            size, angle = np.abs(response), np.angle(response)
            parts = {
                "parts": {"real": response.real, "imag": response.imag, "var": variances},
                "polar": {"Magnitude": size, "Phase (deg)": np.degrees(angle)},
                "bode": {"Magnitude (dB)": 20.0 * np.log10(size), "Phase [rad]": angle},
                "spelled": {"mag (dB re 1 m/N)": 20.0 * np.log10(size), "phase (Radians)": angle},
                "milli": {"mag": size, "phase [mrad]": 1e3 * angle},
                "micro": {"mag": size, "phase [µrad]": 1e6 * angle},
            }
            columns |= {f"{name} {part}": column for part, column in parts[form].items()}
        pd.DataFrame(columns).to_csv(path, index=False)
    read = read_responses(path, asked(("force",), ("mid", "tip"), frequency="f"))
    np.testing.assert_allclose(read.values[:, :, 0], values[:, ::-1], atol=1e-12)
    assert read.input_names == ("force",)
    assert read.are_absolute == (form == "parts")
    with pytest.raises(InputError, match='"end real" and "end imag", or magnitude and phase'):
        read_responses(path, asked(("force",), ("end",), frequency="f"))


@pytest.mark.parametrize(
    ("columns", "said"),
    [
        ({"tip mag": 1.0}, "no columns hold the response of tip to force; name them"),
        ({"tip re": 1.0, "tip im": 0.0, "tip coh": 99.0}, "frequency 1: a coherence lies outside"),
    ],
)
def test_a_response_without_phase_and_coherences_in_percent_are_refused(tmp_path, columns, said):
    """They had been taken for a phase of 0 and for coherences of 1."""
    table = pd.DataFrame({"f (Hz)": FREQUENCIES} | columns)
    table.to_csv(tmp_path / "frf.csv", index=False)
    with pytest.raises(InputError, match=said):
        read_responses(tmp_path / "frf.csv", asked(("force",), ("tip",), frequency="f"))


def test_patterns_stand_for_the_responses_of_a_table(tmp_path, capsys):
    path, columns = tmp_path / "frf.csv", {"f (Hz)": FREQUENCIES}
    for output, reference in (("tip", "hit"), ("tip", "fan"), ("mid", "hit"), ("mid", "fan")):
        of_pair = f"{output}/{reference}"
        columns |= {f"{of_pair} Magnitude": FREQUENCIES, f"{of_pair} Phase (deg)": FREQUENCIES}
    pd.DataFrame(columns).to_csv(path, index=False)
    read = read_responses(path, asked(("*",), ("m*", "*"), frequency="f"))
    assert (read.input_names, read.output_names) == (("hit", "fan"), ("mid", "tip"))
    with pytest.raises(InputError, match=r"of q to hit, but of tip/hit, tip/fan, mid/hit, mid/fan"):
        read_responses(path, asked(("hit",), ("q",), frequency="f"))
    assert main([str(path)]) == 1
    sentence = "(tip/hit, tip/fan, mid/hit, mid/fan); give evopem"
    assert f"it seems to hold frequency responses {sentence}" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("change", "problem"),
    [
        ({"frequencies": FREQUENCIES[::-1]}, "frequency 2: the frequencies do not increase"),
        ({"values": np.full(150, np.nan)}, "frequency 1: a response is not finite"),
        ({"variances": np.zeros(150)}, "its variance not above 0"),
        ({"frequencies": FREQUENCIES[:9], "values": np.ones(9)}, "10 or more"),
    ],
)
def test_responses_that_cannot_be_used(change, problem):
    given = {"frequencies": FREQUENCIES, "values": np.ones(150)} | change
    with pytest.raises(InputError, match=problem):
        FrequencyResponses(**given)


@pytest.fixture(scope="module")
def identified(tmp_path_factory):
    """The results folder of two noisy responses, and what the command printed."""
    folder = tmp_path_factory.mktemp("responses")
    given = noisy(2, deviation=0.1)
    table = {"f": FREQUENCIES}
    for k, name in enumerate(("tip", "mid")):
        table |= {
            f"{name} re": given.values[:, k, 0].real,
            f"{name} im": given.values[:, k, 0].imag,
        }
    places = {name: {"point": name, "direction": "z"} for name in ("tip", "mid")}
    points = {"mid": [1, 0, 0], "tip": [2, 0, 0]}
    of_all = {"orders": {"nx": [2, 6]}, "structure": "armax", "continuous_time": "zero-order"}
    geometry = {"points": points, "lines": [["mid", "tip"]], "channels": places}
    content = {"defaults": of_all | {"geometry": geometry}}
    with pytest.MonkeyPatch.context() as patch, redirect_stdout(StringIO()) as said:
        patch.chdir(folder)
        pd.DataFrame(table).to_csv("frf.csv", index=False)
        Path("config.yaml").write_text(yaml.safe_dump(content))
        options = ["--frequency", "f", "--input", "force", "--output", "tip", "--output", "mid"]
        assert main(["frf.csv", *options, "--config", "config.yaml", "--json"]) == 0
    return folder / "results" / "frf", said.getvalue()


def test_one_response_of_sampled_signals(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    given = noisy(1, deviation=0.1).values[:, 0, 0]
    columns = {"f": FREQUENCIES, "y re": given.real, "y im": given.imag, "y var": 0.01}
    pd.DataFrame(columns).to_csv("frf.csv", index=False)
    Path("config.yaml").write_text("defaults: {orders: {nx: [4, 4]}}")
    options = ["--frequency", "f", "--input", "u", "--output", "y", "--rate", "200"]
    assert main(["frf.csv", *options, "--config", "config.yaml"]) == 0
    assert "from 150 frequencies" in capsys.readouterr().out
    page = (tmp_path / "results" / "frf" / "report.html").read_text()
    assert "in discrete time at the stated 200" in page
    assert "weighed by the variances in the file" in page
    assert "Number of modes in its range" not in page  # it was given


def test_the_command_writes_results_and_a_report(identified):
    results, _ = identified
    model = evopem.load(results / "model.json")
    np.testing.assert_allclose([m.frequency_hz for m in model.modes()], HERTZ, rtol=1e-3)
    page = (results / "report.html").read_text()
    for words in ("continuous time", "Not applied, because they need a recording in time", "tip"):
        assert words in page
    assert "Number of modes in its range" in page
    assert 'id="residual_tests"' not in page
    assert "zero of the noise filter" not in page  # there is no noise model
    for figure in ("gain", "stabilization", "frequency_response", "nyquist"):
        assert f'<section id="{figure}"' in page
    summary = json.loads((results / "summary.json").read_text())
    assert all(summary["trusted"])
    assert len(pd.read_csv(results / "spectrum.csv")) == 300


def test_the_model_in_s_leaves_and_shapes_are_drawn_over_the_geometry(identified):
    results, _ = identified
    model = evopem.read_results(results).results.model.continuous.model
    true, found = responses_at(FREQUENCIES, 2), model.frequency_response(FREQUENCIES)
    assert np.linalg.norm(found - true) < 0.01 * np.linalg.norm(true)
    quantities = {name: (value, error) for name, value, error, _ in model.quantities()}
    value, error = quantities["static gain"]
    assert abs(value - responses_at(np.zeros(1))[0, 0, 0].real) < 4.0 * error
    stored = loadmat(results / "model.mat")["Continuous"][0, 0]
    s, at = 2j * np.pi * 20.0, (1, 0)
    parts = (stored[name][at][0] for name in ("Numerator", "Denominator"))
    above, below = (np.polyval(part, s) for part in parts)
    assert np.isclose(above / below, model.frequency_response([20.0])[0, 1, 0], rtol=1e-9)
    page = (results / "report.html").read_text()
    assert "Fitted to the responses in <i>s</i>." in page
    assert "half the sampling rate: faster ones" not in page
    assert 'aria-label="Shape of mode 2 at 31\u202fHz, moving"' in page


def test_a_geometry_of_other_outputs_is_refused(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    columns = {"f": FREQUENCIES, "y re": FREQUENCIES, "y im": FREQUENCIES}
    pd.DataFrame(columns).to_csv("frf.csv", index=False)
    channels = "channels: {tip: {point: a, direction: z}}"
    Path("config.yaml").write_text(f"defaults: {{geometry: {{points: {{a: [0, 0]}}, {channels}}}}}")
    options = ["--frequency", "f", "--input", "u", "--output", "y", "--config", "config.yaml"]
    with pytest.raises(SystemExit):
        main(["frf.csv", *options])
    sentence = """frf.geometry, channels.tip: there is no output "tip"; choose one of 1 'y'."""
    assert sentence in capsys.readouterr().err


def test_the_verdict_for_programs_is_of_the_responses(identified):
    results, said = identified
    verdict = json.loads(said)
    assert said == (results / "verdict.json").read_text()
    answers = {use["key"]: use["answer"] for use in verdict["uses"]}
    assert set(answers) == {"frequency_response", "modes", "standard_errors"}
    assert answers["modes"] == "good"
    np.testing.assert_allclose([m["frequency_hz"] for m in verdict["modes"]], HERTZ, rtol=1e-3)
    assert verdict["estimation_samples"] == 150


def test_results_of_responses_are_read_and_compared(identified, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    results, _ = identified
    found = evopem.read_results(results)
    assert "the modes at" in found.verdict
    assert found.modes["trusted"].all()
    assert len(found.shapes) == 2
    # The bands are those of the responses in continuous time: within four standard errors.
    table = found.results.responses
    for k, name in enumerate(("tip", "mid")):
        model = table[(table["source"] == "model") & (table["output"] == name)].iloc[1:]
        true = np.abs(responses_at(model["frequency_hz"].to_numpy(), 2)[:, k, 0])
        half = (model["gain_upper"] - model["gain_lower"]) / 2.0
        assert (np.abs(model["gain"] - true) / half).max() < 2.0
        assert (half / true).median() < 0.02
    assert main(["compare", str(results), str(results)]) == 0
    page = Path("comparison.html").read_text()
    assert "2 models" in page
    assert "150 frequencies" in page
    assert "frf" in capsys.readouterr().out
    assert main(["compare", str(results), str(results), "--setups"]) == 0
    said = capsys.readouterr().out
    assert "2 set-ups and 2 outputs; force, mid and tip in all set-ups. No set-up contra" in said


@pytest.mark.parametrize("rate", [None, 120.0])
def test_a_fit_shows_plots_and_saves_itself(rate, tmp_path):
    units = {"input_units": ("N",), "output_units": ("m", ""), "sampling_rate": rate}
    fit = fit_responses(replace(noisy(2, seed=3), **units), modes=(2, 3), seed=4)
    assert fit.modes["trusted"].tolist() == [True, True]
    assert fit.modes["frequency_hz"].tolist() == [m.frequency_hz for m in fit.model.modes()]
    assert f"{fit.error_percent:.3g}\u202f% of the frequency responses" in repr(fit)
    assert len(fit.shapes) == 2
    assert [axes.has_data() for axes in fit.plot_gain()] == [True, True]
    (told,) = fit.plot_simulation().texts
    assert "no samples in time" in told.get_text()
    folder = fit.save(tmp_path / "kept")
    settings = read_settings(folder / "config.yaml")
    assert settings.search.seed == 4
    again = evopem.read_results(folder)
    assert list(fit.compare(again, labels=("a", "b")).table.index) == ["a", "b"]
    files = DatasetFiles(str(tmp_path / "again"))
    identify_responses(files, settings, folder=folder)
    for name in ("model.json", "validation.json", "frequency_response.csv"):
        assert Path(files.folder, name).read_bytes() == (folder / name).read_bytes()


def test_a_saved_fit_has_the_variances_that_were_known_but_for_a_factor(tmp_path):
    given = noisy(2, seed=3)
    given = replace(given, variances=9.0 * given.variances, are_absolute=False)
    fit = fit_responses(given, modes=(2, 2))
    folder = fit.save(tmp_path / "kept")
    files = DatasetFiles(str(tmp_path / "again"))
    identify_responses(files, read_settings(folder / "config.yaml"), folder=folder)
    again = load(ModelRecord, files.model)
    for mode, kept in zip(again.modes, fit.model.modes(), strict=True):
        assert mode.frequency_hz == pytest.approx(kept.frequency_hz, rel=1e-6)
        assert mode.frequency_se_hz == pytest.approx(kept.frequency_se_hz, rel=1e-3)


def test_keys_that_responses_do_not_have():
    keys = {"file": "frf.csv", "frequency": "f", "input": "u", "output": "y"}
    settings = complete({"datasets": {"a": keys | {"orders": {"nx": [2, 8]}}}}).datasets["a"]
    # The response of the place that is driven has the name of its input.
    complete({"datasets": {"a": keys | {"input": "*", "output": "*"}}})
    again = complete({"datasets": {"a": settings.keys}}).datasets["a"]
    assert again == settings
    for key, value in (("structure", "oe"), ("time", "t"), ("resample", 10.0)):
        with pytest.raises(InputError, match=f"{key}: frequency responses are no samples in time"):
            complete({"datasets": {"a": keys | {key: value}}})
    with pytest.raises(InputError, match="one file"):
        complete({"datasets": {"a": keys | {"file": ["a.csv", "b.csv"]}}})


def test_a_file_that_is_not_there_is_said(tmp_path):
    for name in ("none.uff", "none.csv"):
        with pytest.raises(InputError, match="there is no such file"):
            read_responses(tmp_path / name, asked(("u",), ("y",), frequency="f"))
