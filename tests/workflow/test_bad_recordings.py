"""Recordings that cannot be used: one sentence each, before any search, and nothing left behind."""

import re

import pytest

from .bad_recordings import BAD, GOOD, PAYLOAD_RAN, RATE, VALIDATION_FILES, text, write
from .conftest import TINY, Folder

DEFAULTS = TINY["defaults"] | {
    "stationarity": {"box_cox": "none", "difference": 0},
    "split": {"discard": 0},
}


@pytest.fixture(scope="module")
def judged(tmp_path_factory):
    """One run over every bad recording and one good one: its folder and what it printed."""
    folder = Folder(tmp_path_factory.mktemp("bad"))
    datasets = {name: write(folder.path, name, bad) for name, bad in BAD.items()}
    for name, content in {**VALIDATION_FILES, "good.csv": text(GOOD)}.items():
        (folder.path / name).write_text(content)
    datasets["good"] = {"file": "good.csv", **RATE}
    folder.configure({**TINY, "defaults": DEFAULTS, "datasets": datasets})
    before = {path.name for path in folder.path.iterdir()}
    run = folder.run("--cores", "2")
    return folder, run, before


@pytest.mark.parametrize("name", BAD)
def test_a_bad_recording_gets_one_sentence_before_any_search(judged, name):
    folder, run, _ = judged
    results = folder.results / name
    logs = [log.read_text() for log in (results / "logs").glob("*.log")]
    (sentence,) = "".join(logs).splitlines()
    sentence = re.sub(r"^[0-9:]+ ", "", sentence)
    assert BAD[name].says in sentence
    assert re.fullmatch(r".+: .+; .+\.", sentence), "where: what; what to do."
    files = {BAD[name].name or f"{name}.csv", BAD[name].keys.get("validation_file")}
    assert sentence.startswith((*filter(None, files), f"datasets.{name}."))
    # Not counting the log with its times, which is shown as well. Snakemake writes its own messages
    # in pieces: a sentence may stand behind the first one.
    said = re.findall(rf"(?<!\d\d:\d\d:\d\d ){re.escape(sentence)}\n", run.stdout)
    assert len(said) == 1
    assert not (results / "phases").exists()
    assert not (results / "report.html").exists()


def test_such_a_run_fails_without_a_traceback(judged):
    _, run, _ = judged
    assert run.returncode != 0
    assert "Traceback" not in run.stdout


def test_the_good_recording_of_that_run_is_identified(judged):
    folder, _, _ = judged
    assert (folder.results / "good" / "report.html").exists()


def test_no_recording_ran_code_of_its_own_or_wrote_outside_the_results(judged):
    folder, _, before = judged
    after = {path.name for path in folder.path.iterdir()}
    assert not (folder.path / PAYLOAD_RAN).exists()
    assert after - before == {"results", ".snakemake"}


def test_a_recording_that_was_read_before_and_is_gone_costs_nothing(folder):
    (folder.path / "good.csv").write_text(text(GOOD))
    folder.configure(
        {**TINY, "defaults": DEFAULTS, "datasets": {"one": {"file": "good.csv", **RATE}}}
    )
    folder.finish("--cores", "1")
    before = (folder.results / "one" / "model.json").read_bytes()
    (folder.path / "good.csv").unlink()
    folder.run("--cores", "1")
    assert (folder.results / "one" / "model.json").read_bytes() == before
