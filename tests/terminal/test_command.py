"""The command `evopem`, as a user types it."""

import fcntl
import importlib.util
import json
import os
import re
import shutil
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
import yaml
from scipy.io import loadmat
from scipy.signal import lfilter

import evopem
from evopem.__main__ import main as started
from evopem.config.defaults import complete, read_settings, yaml_text
from evopem.config.keys import COLUMNS
from evopem.report.numbers import with_error
from evopem.signals.reading import read_measured
from evopem.terminal.command import main

from .conftest import SMALL, write_recording

ROOT = Path(__file__).parents[2]
RUN = ("data.csv", "--input", "u", "--output", "y", "--rate", "100", "--config", "small.yaml")
KEYS = {"file": "data.csv", "input": "u", "output": "y", "sampling_rate": 100}
WRITTEN = {"defaults": SMALL, "datasets": {"data": KEYS}}
SETTINGS = complete(WRITTEN).datasets["data"]


def run(folder, *arguments):
    """Run the command in a process of its own."""
    paths = {"PYTHONPATH": os.pathsep.join(filter(None, sys.path))}
    return subprocess.run(
        [sys.executable, "-m", "evopem", *arguments],
        cwd=folder,
        env=os.environ | paths,
        capture_output=True,
        text=True,
        check=False,
    )


def code_of(arguments):
    """The exit code of the command in this process."""
    try:
        return main(arguments)
    except SystemExit as ended:
        return ended.code


@pytest.fixture(scope="module")
def identified_once(tmp_path_factory):
    """A folder in which the command has run, and how it ended."""
    folder = write_recording(tmp_path_factory.mktemp("command"))
    return folder, run(folder, *RUN)


@pytest.fixture
def handed_over(monkeypatch):
    """The settings that the command hands over to be identified; nothing is."""
    settings = []

    def stopped(_, given, *__):
        settings.append(given)
        raise KeyboardInterrupt

    monkeypatch.setattr("evopem.pipeline.identification.identify_dataset", stopped)
    return settings


def test_one_command_identifies_a_recording(identified_once):
    folder, ended = identified_once
    assert ended.returncode == 0, ended.stderr
    model = evopem.load(folder / "results" / "data" / "model.json")
    for mode in model.modes():
        assert with_error(mode.frequency_hz, mode.frequency_se_hz) in ended.stdout
    assert ended.stdout.startswith("data: ")
    assert ended.stdout.endswith("report  results/data/report.html\n")
    assert (folder / "results" / "data" / "report.html").stat().st_size > 100_000
    # The settings are those of the same keys in a configuration.
    assert read_settings(folder / "results" / "data" / "config.yaml") == SETTINGS
    # Progress is on standard error alone, a line for each stage where there is no terminal.
    stages = re.findall(r"^[#.]{10} \[(\d+/\d+)\]", ended.stderr, re.MULTILINE)
    counts = {stage.partition("/")[2] for stage in stages}
    assert len(counts) == 1
    assert len(set(stages)) == int(counts.pop()) > 5


def test_a_program_is_given_the_verdict_alone(identified_once, folder, monkeypatch, capsys):
    """The results are those of the other test's run."""
    made = identified_once[0] / "results" / "data"

    def taken(files, *_):
        shutil.copytree(made, files.folder, dirs_exist_ok=True)

    monkeypatch.setattr("evopem.pipeline.identification.identify_dataset", taken)
    assert main([*RUN, "--json"]) == 0
    printed = capsys.readouterr().out
    assert printed == f"{(made / 'verdict.json').read_text(encoding='utf-8').rstrip()}\n"
    assert json.loads(printed)["dataset"] == "data"


def test_the_exit_codes_are_those_of_the_documentation(folder, handed_over):
    page = (ROOT / "docs" / "terminal.md").read_text(encoding="utf-8")
    said = re.findall(r"^\| (\d+) \| (.*) \|$", page, re.MULTILINE)
    ways = ["--config", "missing.yaml"], ["--wrong"], []
    codes = [code_of([*RUN, *further]) for further in ways]
    assert codes == [1, 2, 130]
    assert [int(code) for code, _ in said] == [0, *codes]


def test_a_second_run_that_fails_or_is_stopped_leaves_the_results_of_the_first(
    identified_once, folder, monkeypatch, capsys
):
    shutil.copytree(identified_once[0] / "results", folder / "results")
    results = folder / "results" / "data"
    made = [path for path in results.rglob("*") if path.is_file() and path.parent.name != "logs"]
    before = {path: path.read_bytes() for path in made}
    with pytest.raises(SystemExit):
        main([RUN[0], "--input", "nothing", *RUN[3:]])
    assert "nothing" in capsys.readouterr().err

    def stopped(files, *_, **__):
        Path(files.folder).mkdir(parents=True)
        Path(files.model).write_text("{}")
        raise KeyboardInterrupt

    monkeypatch.setattr("evopem.pipeline.identification.identify_dataset", stopped)
    assert main(RUN) != 0
    assert {path: path.read_bytes() for path in made} == before
    assert evopem.read_results(results).name == "data"
    assert not list(results.glob(".writing-*"))


def test_a_configuration_that_decides_nothing_is_refused(folder, handed_over, capsys):
    Path("top.yaml").write_text("structure: arx\n")
    assert code_of([*RUN[:-1], "top.yaml"]) == 1
    assert "top.yaml: it has no `defaults:`, which alone count" in capsys.readouterr().err
    assert handed_over == []


def test_two_runs_do_not_write_the_same_results_at_once(folder, handed_over, capsys):
    """The second one deleted what the first one had made, which ended in a traceback."""
    results = folder / "results" / "data"
    results.mkdir(parents=True)
    other = os.open(results, os.O_RDONLY)
    fcntl.flock(other, fcntl.LOCK_EX)
    assert code_of(RUN) == 1
    assert "results/data: another run writes results there; wait" in capsys.readouterr().err
    assert list(results.iterdir()) == []
    os.close(other)
    assert code_of(RUN) == 130
    assert len(handed_over) == 1


def test_an_exchange_of_results_that_is_stopped_leaves_no_mixture(
    identified_once, folder, monkeypatch
):
    shutil.copytree(identified_once[0] / "results", folder / "results")
    results = folder / "results" / "data"

    def in_part(files, *_, **__):
        Path(files.folder).mkdir(parents=True)
        Path(files.model).write_text("{}")

    def stopped(folder, _):
        yield Path(folder) / "model.json"
        raise KeyboardInterrupt

    monkeypatch.setattr("evopem.pipeline.identification.identify_dataset", in_part)
    monkeypatch.setattr("evopem.pipeline.identification.files_below", stopped)
    assert main(RUN) != 0
    assert not (results / "validation.json").exists()
    with pytest.raises(evopem.InputError, match="holds no results"):
        evopem.read_results(results)
    with pytest.raises(evopem.InputError, match=r"model\.json: is of an unfinished run"):
        evopem.load(results / "model.json")


def test_several_channels_and_recordings_have_modes_and_a_report(folder, undrawn, capsys):
    written = {"orders": {"nx": [3, 3]}, "form": "ss", "search": {"evaluations": 1}}
    (folder / "small.yaml").write_text(yaml.safe_dump({"defaults": written}))
    table = np.loadtxt("data.csv", delimiter=",", skiprows=1)
    noise = np.random.default_rng(1).standard_normal(len(table)) * table[:, 2].std()
    table = np.column_stack([table, np.roll(table[:, 2], 2) + noise])
    files = ["one.csv", "two.csv", "three.csv"]
    for name, rows in zip(files, np.split(table, [250, 450]), strict=True):
        np.savetxt(name, rows, delimiter=",", header="time,u,y_1,y_2", comments="")
    # The rate is that of the channel named as a time.
    given = ["--input", "u", "--output", "y_*", "--config", "small.yaml"]
    assert main([*files, *given]) == 0
    shown = capsys.readouterr().out
    assert "state space, 3 states (innovations" in shown
    assert "at 100 Hz" in shown
    assert shown.endswith("report  results/one/report.html\n")
    results = folder / "results" / "one"
    page = (results / "report.html").read_text()
    assert "y_2" in page
    assert all(f"<dd>{name}</dd>" in page for name in files)
    model = evopem.load(results / "model.json")
    assert isinstance(model, evopem.StateSpaceModel)
    assert model.output_names == ("y_1", "y_2")
    np.testing.assert_array_equal(model.A, loadmat(results / "model.mat")["A"])
    assert main(["one.csv", *given]) == 1
    assert "it holds the results of one.csv, two.csv, three.csv" in capsys.readouterr().err


def test_results_of_another_recording_are_not_overwritten(folder, handed_over, capsys):
    results = folder / "results" / "data"
    results.mkdir(parents=True)
    (results / "config.yaml").write_text(yaml_text(SETTINGS))
    (results / "report.html").write_text("")
    (folder / "other").mkdir()
    (folder / "data.csv").rename(folder / "other" / "data.csv")
    assert main(["other/data.csv", *RUN[1:]]) == 1
    assert "it holds the results of data.csv" in capsys.readouterr().err
    assert {path.name for path in results.iterdir()} == {"config.yaml", "report.html"}
    # What a run that failed has left is no result.
    (results / "report.html").unlink()
    main(["other/data.csv", *RUN[1:]])
    assert [each.source.files for each in handed_over] == [("other/data.csv",)]


def test_another_project_s_file_of_the_same_name_replaces_no_results(folder, monkeypatch, capsys):
    """Of results elsewhere, a relative name does not tell the file."""
    results = folder / "elsewhere" / "data"
    results.mkdir(parents=True)
    (results / "config.yaml").write_text(yaml_text(SETTINGS))
    (results / "report.html").write_text("")
    own = folder / "project"
    own.mkdir()
    (own / "small.yaml").write_text((folder / "small.yaml").read_text())
    (own / "data.csv").write_text((folder / "data.csv").read_text() + "6.0,0.1,0.2\n")
    (own / "link").symlink_to(results.parent)
    monkeypatch.chdir(own)
    for written in (str(results.parent), "../elsewhere", "link"):
        assert main([*RUN, "--results", written]) == 1
        assert "it holds the results of data.csv" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("arguments", "sentence"),
    [
        (["no.csv", *RUN[1:]], "no.csv: there is no such file"),
        (["data.csv", "--input", "q", *RUN[3:]], 'data.csv: there is no column "q"'),
        ([*RUN[:5], "--rate", "-3"], "--rate: -3 is below 1e-09"),
        ([*RUN[:5], "--rate", "50", "--config", "no.yaml"], "no.yaml: there is no such file"),
        (["data.csv", "--input", "u", "--output", "u"], "--output: u is both input and output"),
        ([*RUN, "--results", "x" * 300], f"{'x' * 300}/data: cannot be the name of a folder"),
        ([*RUN, "--results", "data.csv"], "data.csv: is no folder, and the results need"),
        ([*RUN, "--results", "gone"], "gone: is no folder, and the results need"),
        (["data.csv", "--input", "u", "--output", "none"], "--output: there is no output"),
        (["b" * 300, *RUN[1:]], f"{'b' * 300}: file name too long; give another path."),
        (["compare", "b" * 300, "."], f"{'b' * 300}/config.yaml: file name too long"),
        (["init", "b" * 300], f"{'b' * 300}: file name too long"),
        (["-rf.csv", *RUN[1:]], "-rf.csv: begins with -, as options do; write ./-rf.csv."),
    ],
)
def test_bad_input_is_said_in_one_sentence(folder, capsys, arguments, sentence):
    (folder / "gone").symlink_to("nowhere")
    (folder / "-rf.csv").touch()
    assert code_of(arguments) == 1
    printed = capsys.readouterr().err.splitlines()
    said = [line for line in printed if not re.match(r"[#.]{10} \[", line)]
    assert len(said) == 1
    assert said[0].startswith(sentence)
    assert said[0].endswith(".")


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (("--output", "2", "3"), "3 stands without an option: write --output before each channel"),
        (("--input", "1", "2", "--output", "3"), "2 stands without an option: write --input"),
        (("--outputs", "3"), "unrecognized arguments: --outputs"),
    ],
)
def test_a_second_channel_behind_one_option_is_told_how_to_be_given(arguments, said, capsys):
    with pytest.raises(SystemExit) as ended:
        main(["data.csv", "--input", "1", "--output", "2", *arguments])
    assert ended.value.code == 2
    assert said in capsys.readouterr().err


def test_a_missing_input_says_how_there_may_be_none(capsys):
    with pytest.raises(SystemExit):
        main(["data.csv", "--output", "2"])
    assert "--input none where only outputs were recorded" in capsys.readouterr().err


def test_channels_that_names_or_a_test_tell_need_no_option(folder, handed_over, capsys):
    """Times and signals, by their names and, renamed and turned, by causality."""
    table = np.loadtxt("data.csv", delimiter=",", skiprows=1)
    turned = {"delimiter": ",", "header": "time,b,a", "comments": ""}
    np.savetxt("turned.csv", table[:, [0, 2, 1]], **turned)
    for file, said, names in (
        ("data.csv", "data.csv: input u; output y; time time, by their names.", ("u", "y")),
        ("turned.csv", "turned.csv: “a” is the input and “b” the output: the past", ("a", "b")),
    ):
        assert main([file, "--config", "small.yaml"]) == 130
        assert capsys.readouterr().err.startswith(said)
        channels = handed_over.pop().source.channels
        assert (*channels.inputs, *channels.outputs, channels.time) == (*names, "time")
    main(["data.csv", "--rate", "50", "--config", "small.yaml"])
    channels = handed_over[0].source.channels
    assert (channels.sampling_rate, channels.time) == (50.0, None)


@pytest.mark.parametrize(
    ("heading", "example"),
    [
        ("time,a b,c,d", "--input 'a b' --output c."),
        ("time,acc_1,acc_2,acc_3", "--input none --output acc_1 --output acc_2 --output acc_3."),
        ("7,1,1,1", "--input 1 --output 2 --rate HZ."),
    ],
)
def test_channels_that_nothing_tells_are_asked_for(folder, capsys, heading, example):
    signals = np.random.default_rng(1).standard_normal((200, 3))
    table = np.column_stack([np.arange(200) / 100, signals])
    np.savetxt("log.csv", table, delimiter=",", header=heading, comments="")
    assert code_of(["log.csv"]) == 1
    said = capsys.readouterr().err
    assert said.startswith("log.csv: which of its channels are inputs and outputs is not certain (")
    assert said.endswith(f"; name them, as in: evopem log.csv {example}\n")
    assert not Path("results").exists()


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("t,u,y\n0,1,2\n", "log.csv: none of its channels holds numbers that change; give"),
        ("1 s;2 N\n" * 9, 'log.csv, line 1, column 2: "s;2" is not a finite number; repair'),
        ("u,y\non,1\non,2\non,4\n", 'change (line 2, column 1: "on" is not a finite number); name'),
    ],
)
def test_a_file_without_signals_is_refused_by_what_is_wrong(folder, capsys, text, said):
    Path("log.csv").write_text(text)
    assert code_of(["log.csv"]) == 1
    assert said in capsys.readouterr().err


def test_infinite_samples_warn_of_nothing_and_a_path_with_a_blank_is_quoted(
    folder, capsys, recwarn
):
    signals = np.random.default_rng(1).standard_normal((200, 3))
    np.savez("a log.npz", a=signals[:, 0], b=signals[:, 1], c=np.full(200, -np.inf))
    assert code_of(["a log.npz"]) == 1
    assert "evopem 'a log.npz' --input a --output b" in capsys.readouterr().err
    assert [str(warning.message) for warning in recwarn] == []


def test_of_a_folder_is_said_what_would_be_taken(folder, capsys):
    assert main(["."]) == 0
    shown = capsys.readouterr().out
    assert '    input: u\n    output: "y"\n    time: time  # 100 Hz\n' in shown
    assert shown.endswith("evopem init . writes this as ./config.yaml.\n")
    assert not Path("config.yaml").exists()


def test_a_single_output_is_identified_without_an_input(folder, undrawn):
    written = {"orders": {"nx": [4, 4]}, "search": {"evaluations": 1}}
    (folder / "small.yaml").write_text(yaml.safe_dump({"defaults": written}))
    alone = ["--input", "none", "--output", "y", "--rate", "100", "--config", "small.yaml"]
    assert main(["data.csv", *alone]) == 0
    assert evopem.read_results("results/data").modes["frequency_hz"].size > 0


def test_a_deleted_working_folder_is_said(folder, monkeypatch, capsys):
    (folder / "here").mkdir()
    monkeypatch.chdir(folder / "here")
    (folder / "here").rmdir()
    assert main(RUN) == 1
    assert "the folder that this terminal is in no longer exists" in capsys.readouterr().err
    monkeypatch.chdir(folder)


def test_a_missing_extra_is_named(folder, monkeypatch, capsys):
    found = importlib.util.find_spec
    missing = {"pandas", "jinja2"}
    monkeypatch.setattr(
        importlib.util, "find_spec", lambda name: None if name in missing else found(name)
    )
    assert main(RUN) == 1
    said = capsys.readouterr().err
    assert "pandas, jinja2, which are not installed" in said
    assert 'pip install "evopem[report]"' in said
    assert not (folder / "results").exists()


def test_an_interruption_while_modules_load_is_one_line(monkeypatch, capsys):
    class Interrupted:
        @staticmethod
        def find_spec(name, *_):
            if name == "evopem.terminal.command":
                raise KeyboardInterrupt

    monkeypatch.delattr("evopem.terminal.command")
    monkeypatch.delitem(sys.modules, "evopem.terminal.command")
    monkeypatch.setattr(sys, "meta_path", [Interrupted, *sys.meta_path])
    assert started() == 130
    assert capsys.readouterr().err.strip() == "interrupted"


def test_version_and_help_need_no_library(tmp_path):
    code = (
        "import sys\n"
        "for name in ('numpy', 'scipy', 'numba', 'pandas'):\n"
        "    sys.modules[name] = None\n"
        "from evopem.terminal.command import main\n"
        "main(sys.argv[1:])\n"
    )
    paths = {"PYTHONPATH": os.pathsep.join(filter(None, sys.path))}
    for option, shown in (("--version", evopem.__version__), ("--help", "--rate HZ")):
        ended = subprocess.run(
            [sys.executable, "-c", code, option],
            cwd=tmp_path,
            env=os.environ | paths,
            capture_output=True,
            text=True,
            check=False,
        )
        assert (ended.returncode, ended.stderr) == (0, "")
        assert shown in ended.stdout


def test_the_help_of_an_option_is_what_the_documentation_says_of_its_key(capsys):
    with pytest.raises(SystemExit):
        main(["--help"])
    shown = "".join(capsys.readouterr().out.split())
    rows = Path(evopem.__file__).parents[3] / "docs" / "configuration.md"
    documented = rows.read_text(encoding="utf-8")
    for key in ("input", "output", *COLUMNS):
        clause = re.search(rf"^\| `{key}` \| ([^,.|]+)", documented, re.MULTILINE)[1]
        assert clause.replace(" ", "") in shown, key


def test_init_writes_a_configuration_that_is_accepted(folder, capsys):
    assert main(["init"]) == 0
    written = (folder / "config.yaml").read_text()
    settings = complete(yaml.safe_load(written)).datasets["data"]
    channels = settings.source.channels
    assert (channels.inputs, channels.outputs, channels.time) == (("u",), ("y",), "time")
    assert "# 100 Hz" in written
    # It is the user's from then on.
    assert main(["init"]) == 1
    assert "exists already" in capsys.readouterr().err
    assert (folder / "config.yaml").read_text() == written


def test_what_an_error_asks_for_is_an_option(folder, capsys, request):
    """A clock in whole milliseconds, under a name that does not say so."""
    table = np.loadtxt("data.csv", delimiter=",", skiprows=1)
    table[:, 0] *= 1000
    np.savetxt("data.csv", table, "%.10g", ";", header="stamp;u;y", comments="note\n")
    given = ["data.csv", "--input", "u", "--output", "y", "--config", "small.yaml"]
    for asked, sentence in (
        (["--time", "stamp"], "set --time-unit to one of s, ms"),
        ([], "give --rate in Hz"),
    ):
        assert code_of([*given, *asked]) == 1
        assert sentence in capsys.readouterr().err
    handed_over = request.getfixturevalue("handed_over")
    options = ["--time-unit", "ms", "--header-lines", "2", "--decimal-mark", "."]
    main([*given, "--time", "stamp", *options])
    channels = handed_over[0].channels
    assert (channels.time_unit, channels.header_lines, channels.decimal_mark) == ("ms", 2, ".")
    assert read_measured("data.csv", channels)[0].sampling_rate == 100


def test_a_single_step_is_identified(folder, undrawn, capsys):
    """The input rests from the third second on, and thus in all samples that validate."""
    table = np.loadtxt("data.csv", delimiter=",", skiprows=1)
    table[:, 1] = table[:, 0] >= 2.0
    noise = 0.01 * np.random.default_rng(2).standard_normal(len(table))
    table[:, 2] = lfilter([0.1], [1.0, -1.8, 0.9], table[:, 1]) + noise
    np.savetxt("data.csv", table, delimiter=",", header="time,u,y", comments="")
    assert main([*RUN]) == 0
    shown = capsys.readouterr().out
    # What is left to predict there is noise; the step before tells the mode.
    assert shown.replace("\u202f", " ").startswith(
        "data: Good for the mode at 5.17 Hz; with care for standard errors; not for"
    )
    page = (folder / "results" / "data" / "report.html").read_text()
    assert "not tested: the input does not change in the validation samples" in page
    model = evopem.load(folder / "results" / "data" / "model.json")
    frequency = min(model.modes(), key=lambda mode: mode.damping_ratio).frequency_hz
    pole = np.log(np.roots([1.0, -1.8, 0.9])[0]) * 100
    assert frequency == pytest.approx(abs(pole) / (2 * np.pi), rel=0.02)
