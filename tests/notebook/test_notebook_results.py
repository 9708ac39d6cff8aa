"""`evopem.identify` on signals in memory, and what its results show, compare and keep."""

import io
import re
import subprocess
import sys
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pandas as pd
import pytest
import yaml
from scipy.signal import lfilter

import evopem
from evopem.config.defaults import complete
from evopem.files.json_form import load
from evopem.pipeline.identification import ProgressLine, identify_dataset, jobs, progress
from evopem.pipeline.planning.stages import STAGES, left_in_words, seconds_left
from evopem.report.numbers import THIN
from evopem.report.verdict import verdict
from evopem.results.dataset import read_results
from evopem.results.layout import FIGURES, DatasetFiles
from evopem.signals.recording_info import RecordingInfo

RATE = 10.0
POLES = [1.0, -1.5, 0.7]
QUICK = {
    "structure": "oe",
    "orders": {"plant": [1, 3], "nb": [1, 3]},
    "search": {"evaluations": 300},
    "spectrum": {"nfft": 512},
}
ROUND_PLOTS = (
    *("measured_and_simulated", "gain", "nyquist", "step_response", "impulse_response"),
    *("stabilization", "residual_spectrum", "spectrum", "horizons"),
)
WIDE_PLOTS = {"frequency_response": 3, "poles_zeros": 2, "residual_correlation": 2}


def signals(samples=400, seed=1):
    u, e = np.random.default_rng(seed).standard_normal((2, samples))
    return u, 3.0 + lfilter([0.0, 1.0], POLES, u) + 0.1 * e


@pytest.fixture(scope="module")
def found():
    u, y = signals()
    table = pd.DataFrame({"u": u, "y": y}, index=np.arange(u.size) / RATE)
    return evopem.identify(table, input="u", output="y", show_progress=False, **QUICK)


@pytest.fixture(scope="module")
def other():
    u, y = signals()
    keys = {**QUICK, "structure": "arx", "orders": {"plant": [1, 3]}}
    return evopem.identify(u, y, RATE, name="arrays", show_progress=False, **keys)


@pytest.fixture
def pyplot():
    import matplotlib as mpl

    mpl.use("agg")
    from matplotlib import pyplot

    yield pyplot
    pyplot.close("all")


def test_the_model_is_that_of_the_truth_with_its_offset(found):
    assert np.poly(found.model.poles()) == pytest.approx(np.array(POLES), abs=0.01)
    assert found.simulation_error_percent < 8.0
    assert found.modes["trusted"].tolist() == [True]
    assert found.modes["frequency_hz"].iloc[0] == pytest.approx(0.785, abs=0.01)
    assert {each.subject for each in found.decisions} >= {"delay", "folds"}
    assert all(check.passed for check in found.checks if check.name != "Search repeatable")


def test_the_workflow_finds_the_same_in_a_file_of_the_same_signals(found, tmp_path):
    u, y = signals()
    np.savez(tmp_path / "data.npz", u=u, y=y)
    keys = {"file": str(tmp_path / "data.npz"), "input": "u", "output": "y", "sampling_rate": RATE}
    content = {"datasets": {"data": {"recipe": "auto", **keys, **QUICK}}}
    settings = complete(content).datasets["data"]
    files = DatasetFiles(str(tmp_path / "results" / "data"))
    identify_dataset(files, settings, with_report=False)
    again = evopem.Results(files, read_results(files))
    assert np.array_equal(again.model.parameters, found.model.parameters)
    assert again.modes.equals(found.modes)
    assert again.verdict == found.verdict


def test_it_shows_verdict_modes_and_errors(found):
    shown = found._repr_html_()
    assert verdict(found.results).sentence in shown
    assert "<td>0.78" in shown
    assert "not to be trusted" not in shown
    assert "simulation" in shown
    assert found.verdict.replace(THIN, " ") in " ".join(repr(found).split())


@pytest.mark.parametrize("name", ROUND_PLOTS)
def test_a_plot_takes_axes_and_gives_them_back(found, pyplot, name):
    _, axes = pyplot.subplots()
    assert getattr(found, f"plot_{name}")(axes) is axes
    assert axes.has_data()
    own = getattr(found, f"plot_{name}")()
    assert own.figure.number in pyplot.get_fignums()


@pytest.mark.parametrize("name", WIDE_PLOTS)
def test_a_plot_of_several_panels_takes_as_many(found, pyplot, name):
    _, axes = pyplot.subplots(WIDE_PLOTS[name], 1)
    assert getattr(found, f"plot_{name}")(axes) == list(axes)
    assert all(each.has_data() for each in axes)
    with pytest.raises(
        evopem.InputError, match=f"axes: there are 1, and this figure has {len(axes)}"
    ):
        getattr(found, f"plot_{name}")(axes[0])


def test_every_figure_of_the_report_is_a_plot():
    for name in FIGURES:
        plot = getattr(evopem.Results, f"plot_{name}")
        assert plot.__name__ == f"plot_{name}"
        assert plot.__doc__


def test_models_are_compared(found, other, pyplot):
    compared = found.compare(other)
    assert list(compared.table.index) == ["data", "arrays"]
    assert compared.table["simulation_error_percent"].iloc[0] == found.simulation_error_percent
    first = compared.modes[compared.modes["mode"] == 1]
    assert first["data set"].tolist() == ["data", "arrays"]
    assert "All models were validated on the same samples." in repr(compared)
    assert len(compared.plot_frequency_responses()[0].get_lines()) == 2
    assert len(compared.plot_simulations().get_lines()) == 3
    assert compared.plot_modes().has_data()
    assert "<table" in compared._repr_html_()


def test_the_report_is_that_of_the_workflow(found, tmp_path):
    page = found.report(tmp_path / "file.html").read_text(encoding="utf-8")
    assert verdict(found.results).sentence in page
    assert page.count("<svg") > 10
    assert "data.npz" in page
    assert "/tmp/evopem-" not in page


def test_what_is_saved_opens_again_and_can_be_repeated(found, tmp_path, monkeypatch):
    folder = found.save(tmp_path / "kept")
    again = evopem.read_results(folder)
    assert again.modes.equals(found.modes)
    assert found.save(folder) == folder
    keys = yaml.safe_load((folder / "config.yaml").read_text())["datasets"]["data"]
    monkeypatch.chdir(folder)
    assert Path(keys["file"]).is_file()
    info = load(RecordingInfo, folder / "recording.json")
    assert info.files[0].path == keys["file"] == "data.npz"
    (tmp_path / "full").mkdir()
    (tmp_path / "full" / "thesis.tex").touch()
    with pytest.raises(evopem.InputError, match="holds other files than results"):
        found.save(tmp_path / "full")


def test_saving_replaces_nothing_that_evopem_did_not_write(found, tmp_path):
    project = tmp_path / "project"
    found.save(project)
    for name in ("config.yaml", "summary.json"):
        (project / name).write_text("my own\n")
        with pytest.raises(evopem.InputError, match=f"{name}: is not as evopem wrote it"):
            found.save(project)
        assert (project / name).read_text() == "my own\n"
        (project / name).unlink()
    found.save(project)
    assert evopem.read_results(project).modes.equals(found.modes)


def test_modes_can_be_filtered_where_there_are_none(found):
    without = replace(found)
    vars(without)["summary"] = replace(found.summary, modes=(), trusted=())
    trusted = without.modes[without.modes["trusted"]]
    assert list(trusted.columns) == list(found.modes.columns)
    assert trusted.empty


def test_an_independent_recording_validates(found):
    u, y = signals(samples=200, seed=2)
    own = signals()
    validated = evopem.identify(*own, RATE, validation=(u, y), show_progress=False, **QUICK)
    assert validated.results.model.transforms.validation_source == "file"
    assert validated.results.model.transforms.estimation_samples == 400
    assert not found.compare(validated).has_same_validation


def test_several_recordings_are_one_data_set(found):
    tables = []
    for seed, samples in ((1, 250), (2, 200), (3, 150)):
        u, y = signals(samples, seed)
        tables.append(pd.DataFrame({"u": u, "y": y - seed}, index=np.arange(samples) / RATE))
    both = evopem.identify(
        tables[:2], "y", input="u", validation=tables[2:], show_progress=False, **QUICK
    )
    assert both.results.model.transforms.estimation_samples == 450
    assert both.modes["frequency_hz"].iloc[0] == pytest.approx(0.785, abs=0.01)
    assert [path.name for path in Path(both.files.folder).parents[1].glob("*-*.npz")] != []
    y = [table["y"].to_numpy().copy() for table in tables[:2]]
    y[1][9::12] = np.nan  # too many to be filled
    with pytest.raises(evopem.InputError, match=r"^data, recording 2, output"):
        evopem.identify([table["u"] for table in tables[:2]], y, RATE, show_progress=False)


def test_an_output_alone_gives_a_noise_model():
    e = np.random.default_rng(3).standard_normal(600)
    y = lfilter([1.0, 0.5], POLES, e)
    noise = evopem.identify(None, y, RATE, structure="arma", orders=(2, 1), show_progress=False)
    assert str(noise.model.orders) == "ARMA(2,1)"
    assert noise.modes["frequency_hz"].iloc[0] == pytest.approx(0.785, abs=0.1)
    with pytest.raises(evopem.InputError, match="the model has no input"):
        noise.plot_step_response()
    with pytest.raises(evopem.InputError, match="structure oe needs an input, and there is none"):
        evopem.identify(None, y, RATE, structure="oe", show_progress=False)
    small = {"form": "ss", "orders": {"nx": [2, 2]}, "search": {"evaluations": 1}}
    found = evopem.identify(None, y, RATE, show_progress=False, **small)
    assert found.modes["frequency_hz"].iloc[0] == pytest.approx(0.785, abs=0.1)


@pytest.mark.parametrize(
    ("keys", "sentence"),
    [
        ({"strukture": "oe"}, r"strukture: there is no such key \(did you mean structure\?\)"),
        ({"structure": "foo"}, "structure: foo is not known"),
        ({"file": "x.csv"}, "file: it is no key of the analysis"),
        ({"name": "a/b"}, "name: the data set name 'a/b' cannot be the name of a folder"),
        ({"validation": 3.0}, "validation: it is neither a table nor a pair of signals"),
        ({"sampling_rate": None}, "sampling_rate: it is not known; give it in Hz"),
        ({"orders": (2, 2, 1)}, "orders: they are those of one structure, and none is given"),
        ({"structure": "oe", "orders": (2, 2)}, r"'oe' takes the orders \(nb, nf, nk\), not"),
        ({"structure": "ss", "orders": (2, 1, 1)}, "'ss' takes the number of states"),
        ({"orders": {"nk": 1}, "delay": {"nk": 2}}, "the key delay is given as well"),
    ],
)
def test_a_wrong_argument_is_said_in_a_sentence(keys, sentence):
    with pytest.raises(evopem.InputError, match=sentence):
        evopem.identify(*signals(), **{"sampling_rate": RATE, **keys})


TWO = ["u1", "u2"]


@pytest.mark.parametrize(
    ("inputs", "outputs", "keys", "name"),
    [
        ("u1", "y1", {"structure": "oe", "orders": (2, 2, 1)}, "OE(2,2,1)"),
        ("u1", "y1", {"orders": evopem.Orders(nb=2, nf=2, nk=1)}, "OE(2,2,1)"),
        ("u1", "y1", {"structure": "oe", "orders": {"nb": 2, "nf": 2, "nk": 1}}, "OE(2,2,1)"),
        (TWO, "y1", {"structure": "arx", "orders": (2, [2, 1], [1, 2])}, "ARX(2,[2 1],[1 2])"),
        (
            *("u1", "y1"),
            {"structure": "arx", "orders": (2, 1, 1), "recipe": "chapter", "split": {"discard": 0}},
            "ARX(2,1,1)",
        ),
        ("u1", ["y1", "y2"], {"structure": "ss", "orders": 2}, "2 ss (0,)"),
        ("u1", "y1", {"structure": "ss", "orders": (2, 1)}, "2 ss (0,)"),
        (TWO, "y1", {"structure": "ss", "orders": (2, [1, 2])}, "2 ss (0, 1)"),
    ],
)
def test_orders_are_understood_as_by_estimate(inputs, outputs, keys, name):
    rng = np.random.default_rng(1)
    u, e = rng.standard_normal((2, 300, 2))
    y = lfilter([0.0, 1.0], POLES, u[:, :1], axis=0) + 0.1 * e
    frame = pd.DataFrame(np.hstack([u, y]), columns=[*TWO, "y1", "y2"])
    keys = {"search": {"evaluations": 1}, "input": inputs, "show_progress": False} | keys
    model = evopem.identify(frame, outputs, RATE, **keys).model
    states = isinstance(model, evopem.StateSpaceModel)
    of_states = f"{model.order} {model.structure} {model.delays}" if states else ""
    assert (of_states or str(model.orders)) == name


def test_a_bad_signal_is_named_as_it_was_handed_over():
    u, y = signals()
    y[:] = 0.0
    with pytest.raises(evopem.InputError, match=r'^data, output "output": every sample is 0'):
        evopem.identify(u, y, RATE, show_progress=False)


@pytest.fixture
def listed():
    """The jobs of a small recording."""
    keys = {"file": "a.csv", "input": "u", "output": "y", "sampling_rate": RATE}
    settings = complete({"datasets": {"a": keys}}).datasets["a"]
    return jobs(settings, DatasetFiles("a"))


def test_progress_is_shown_in_lines(capsys, listed):
    with progress(shown=False) as announce:
        assert announce is None
    with progress(shown=True) as announce:
        announce(listed, 3)
    assert f"[4/{len(listed)}]" in (lines := capsys.readouterr().err)
    assert listed[3].words in lines


def test_a_notebook_shows_a_bar_and_no_fault(capsys, listed, monkeypatch):
    shell = SimpleNamespace(get_ipython=lambda: SimpleNamespace(kernel=None))
    monkeypatch.setitem(sys.modules, "IPython", shell)
    with progress(shown=True) as announce:
        announce(listed, len(listed) // 2)
    shown = capsys.readouterr()
    assert shown.err == ""
    assert re.search(r"\r#{4,5}\.{5,6} \[", shown.out)


def test_a_line_of_progress_is_overwritten_and_removed(listed):
    line = ProgressLine(stream := io.StringIO(), overwrites=True)
    line.announce(listed, 0)
    line.announce(listed, len(listed) - 1)
    line.tell("a long tale " * 20)
    line.close()
    _, first, _, last, blank, end = stream.getvalue().split("\r")
    assert f"[1/{len(listed)}]" in first
    assert "about" not in first
    assert re.search(r" s, about \d s left  \w", last)
    assert len(last) < 80
    assert (blank.strip(), end) == ("", "")


def test_the_time_left_is_that_of_jobs_done_by_the_weight_of_their_stages():
    done, left = ["prepare", "search_polynomials"], ["choose", "report"]
    seconds = {stage.name: stage.seconds for stage in STAGES}
    weight = {True: sum(map(seconds.get, done)), False: sum(map(seconds.get, left))}
    # As fast as those measured until enough is done, then as slow as it was.
    assert seconds_left(weight[True], done, left) == pytest.approx(weight[False])
    much = [name for name in done for _ in range(1000)]
    slow = seconds_left(3000.0 * weight[True], much, left)
    assert slow == pytest.approx(3.0 * weight[False], rel=0.01)
    assert seconds_left(1.0, ["read_recording"], [*done, *left]) is None
    words = [left_in_words(seconds) for seconds in (0.2, 26.0, 100.0, 4000.0, 9000.0, None)]
    ends = ["1 s", "26 s", "2 min", "67 min", "2 h"]
    assert words == [*(f"about {end} left" for end in ends), ""]


def test_several_channels_are_identified_in_one_call(tmp_path):
    u = np.random.default_rng(4).standard_normal((200, 2))
    first, second = (lfilter([0.0, 1.0], POLES, column) for column in u.T)
    noise = 0.05 * np.random.default_rng(5).standard_normal((200, 2))
    y = np.column_stack([first + 0.3 * second, 0.5 * first - second]) + noise
    table = pd.DataFrame(np.column_stack([u, y]), columns=["hot", "cold", "top", "bottom"])
    small = {"form": "ss", "orders": {"nx": (4, 4)}, "search": {"evaluations": 1}}
    channels = evopem.identify(
        table, ["top", "bottom"], RATE, input=["hot", "cold"], show_progress=False, **small
    )
    assert channels.model.input_names == ("hot", "cold")
    assert channels.simulation_error_percent < 5.0
    assert channels.modes["frequency_hz"].iloc[0] == pytest.approx(0.785, abs=0.02)
    assert list(channels.shapes.columns) == ["top", "bottom"]
    assert channels.verdict in channels._repr_html_().replace("&#x27;", "'")
    assert "state space, 4 states" in repr(channels)
    again = evopem.read_results(channels.save(tmp_path / "kept"))
    assert again.modes.equals(channels.modes)
    assert len(channels.plot_nyquist()) == 4
    assert len(channels.plot_residual_correlation()) == 6


def test_only_results_are_compared(found):
    with pytest.raises(evopem.InputError, match="compare: 'x' is no result"):
        found.compare("x")


def test_the_package_lists_its_public_names_and_no_others():
    assert dir(evopem) == sorted(evopem.__all__)
    code = "import evopem, pydoc; print(pydoc.plain(pydoc.render_doc(evopem)))"
    environment = {"PYTHONPATH": str(Path(evopem.__file__).parents[1]), "PATH": ""}
    shown = subprocess.run(
        [sys.executable, "-c", code], env=environment, capture_output=True, text=True, check=True
    ).stdout
    assert all(name in shown for name in ("identify(", "estimate(", "class Results"))


def test_figures_of_a_notebook_stay_and_so_do_the_users_own(found, tmp_path):
    nbformat, nbclient = pytest.importorskip("nbformat"), pytest.importorskip("nbclient")
    pytest.importorskip("ipykernel")
    scripts = str(Path(evopem.__file__).parents[1])
    cells = [
        f"import sys; sys.path.insert(0, {scripts!r})\nimport evopem\n"
        f"found = evopem.read_results({str(found.save(tmp_path / 'kept'))!r});",
        "found.plot_gain();",
        "found.plot_frequency_response();",
        "import matplotlib.pyplot as plt\nplt.plot([1, 2, 3]);",
    ]
    notebook = nbformat.v4.new_notebook(cells=[nbformat.v4.new_code_cell(each) for each in cells])
    nbclient.NotebookClient(notebook, timeout=300, kernel_name="python3").execute()
    pictures = [
        sum("image/png" in output.get("data", {}) for output in cell.outputs)
        for cell in notebook.cells
    ]
    assert pictures == [0, 1, 1, 1]


def test_missing_packages_are_named_and_the_import_is_light():
    code = """
import sys
for name in ("pandas", "matplotlib", "jinja2", "snakemake"):
    sys.modules[name] = None
import importlib.util
real = importlib.util.find_spec
importlib.util.find_spec = lambda name: None if sys.modules.get(name, 1) is None else real(name)
import evopem
try:
    evopem.identify([1.0] * 50, [2.0] * 50, 1.0)
except evopem.InputError as error:
    print(error)
"""
    scripts = str(Path(evopem.__file__).parents[1])
    run = subprocess.run(
        [sys.executable, "-c", code],
        env={"PYTHONPATH": scripts, "PATH": ""},
        capture_output=True,
        text=True,
        check=True,
    )
    assert run.stdout == (
        "identify: the tables of the results need pandas, jinja2, which are not installed; "
        'run pip install "evopem[report]".\n'
    )
