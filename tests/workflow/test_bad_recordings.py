"""Recordings that cannot be used: one sentence each, before any search, and nothing left behind."""

import logging
import re

import pytest

from evopem.config.defaults import complete
from evopem.files.job import job
from evopem.pipeline.identification import jobs
from evopem.pipeline.planning.stages import PREPARING
from evopem.results.layout import DatasetFiles

from .bad_recordings import BAD, GOOD, PAYLOAD_RAN, RATE, VALIDATION_FILES, text, write
from .conftest import TINY, Folder

DEFAULTS = TINY["defaults"] | {
    "transforms": {"box_cox": "none", "difference": 0},
    "split": {"discard": 0},
}


def assert_one_sentence(sentence, name):
    assert BAD[name].says in sentence
    assert re.fullmatch(r".+: .+; .+\.", sentence), "where: what; what to do."
    files = {BAD[name].name or f"{name}.csv", BAD[name].keys.get("validation_file")}
    assert sentence.startswith((*filter(None, files), f"datasets.{name}."))


@pytest.fixture
def here(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    for name, content in VALIDATION_FILES.items():
        (tmp_path / name).write_text(content)
    return tmp_path


def prepare_recording(name, keys, folder):
    """Run the jobs before the search, as Snakemake does, and say which files they should make."""
    config = {"defaults": DEFAULTS, "datasets": {name: keys}}
    dataset = complete(config).datasets[name]
    files = DatasetFiles(str(folder / "results" / name))
    for own in jobs(dataset, files):
        if own.stage.name in PREPARING:
            with job(files.log(own.name), outputs=own.made):
                own.run()
    return files


@pytest.mark.parametrize("name", BAD)
def test_a_bad_recording_gets_one_sentence_before_any_search(here, name, capsys):
    keys = write(here, name, BAD[name])
    before = {path.name for path in here.iterdir()}
    with pytest.raises(SystemExit) as ended:
        prepare_recording(name, keys, here)
    assert ended.value.code == 1
    (sentence,) = capsys.readouterr().err.splitlines()
    assert_one_sentence(sentence, name)
    logs = [log.read_text() for log in (here / "results").rglob("*.log")]
    (line,) = [line for log in logs for line in log.splitlines()]
    assert line.endswith(sentence)
    made = [path for path in (here / "results").rglob("*.*") if path.suffix in (".npz", ".json")]
    # Reading may succeed where the preparation does not; what it leaves is complete.
    assert not [path for path in made if path.name in ("prepared.npz", "transforms.json")]
    assert not list(here.rglob(".*"))
    # It ran no code of its own and wrote nowhere else.
    assert not (here / PAYLOAD_RAN).exists()
    assert {path.name for path in here.iterdir()} - before == {"results"}


def test_a_good_recording_passes_the_same_stages(here):
    """So that the refusals above are those of the recordings."""
    (here / "good.csv").write_text(text(GOOD))
    files = prepare_recording("good", {"file": "good.csv", **RATE}, here)
    assert (here / "results" / "good" / "prepared.npz").exists()
    assert files.name == "good"


REPRESENTATIVE = ("missing", "words", "npz_pickle", "too_short", "validation_missing", "folder")


@pytest.fixture(scope="module")
def judged(tmp_path_factory):
    """A run over a few bad recordings and a good one: its folder and what it printed."""
    folder = Folder(tmp_path_factory.mktemp("bad"))
    datasets = {name: write(folder.path, name, BAD[name]) for name in REPRESENTATIVE}
    for name, content in {**VALIDATION_FILES, "good.csv": text(GOOD)}.items():
        (folder.path / name).write_text(content)
    datasets["good"] = {"file": "good.csv", **RATE}
    one_job = {"one_job_per": "recording", "report": "none"}
    folder.configure({**TINY, **one_job, "defaults": DEFAULTS, "datasets": datasets})
    before = {path.name for path in folder.path.iterdir()}
    return folder, folder.run("--cores", "2"), before


@pytest.mark.parametrize("name", REPRESENTATIVE)
def test_a_run_says_the_sentence_when_it_fails_and_at_its_end_and_searches_nothing(judged, name):
    folder, run, _ = judged
    results = folder.results / name
    logs = [log.read_text() for log in (results / "logs").glob("*.log")]
    (line,) = "".join(logs).splitlines()
    sentence = re.sub(r"^[0-9:]+ ", "", line)
    assert_one_sentence(sentence, name)
    # Not counting the log with its times, which is shown as well. Snakemake writes its own messages
    # in pieces: a sentence may stand behind the first one.
    said = re.findall(rf"(?<!\d\d:\d\d:\d\d ){re.escape(sentence)}\n", run.stdout)
    assert len(said) == 2
    assert not (results / "phases").exists()


def test_such_a_run_fails_without_a_traceback_and_identifies_the_good_recording(judged):
    folder, run, before = judged
    assert run.returncode != 0
    assert "Traceback" not in run.stdout
    assert (folder.results / "good" / "summary.json").exists()
    assert not (folder.path / PAYLOAD_RAN).exists()
    assert {path.name for path in folder.path.iterdir()} - before == {"results", ".snakemake"}


def test_a_recording_that_was_read_before_and_is_gone_costs_nothing(judged):
    folder, _, _ = judged
    model = folder.results / "good" / "model.json"
    before = model.read_bytes()
    (folder.path / "good.csv").unlink()
    folder.run("--cores", "1", "results/good/model.json")
    assert model.read_bytes() == before


def test_the_packages_logger_has_no_handler_left():
    """The frame of a job, used above in this process, takes its own away again."""
    assert logging.getLogger("evopem").handlers == []
