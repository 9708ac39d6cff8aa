"""Several recordings in one process: what each keeps, and which are identified again."""

import hashlib
import os
import shutil
import zipfile
from contextlib import nullcontext
from pathlib import Path

import numpy as np
import pytest

from evopem.config.defaults import complete
from evopem.errors import InputError
from evopem.files.job import UnfinishedJob
from evopem.pipeline import identification
from evopem.pipeline.identification import identify_dataset
from evopem.results.identity import forget_incomplete_batches, is_finished
from evopem.results.layout import DatasetFiles
from evopem.synthesis import armax

DEFAULTS = {
    "recipe": "chapter",
    "split": {"discard": 20},
    "spectrum": {"nfft": 256},
    "delay": {"orders": [2, 2], "nk": [1, 2]},
    "orders": {"plant": [2, 3], "nc": [2, 2], "nb": [2, 2]},
    "search": {"mu": 3, "lambda": 6, "nu": 2, "evaluations": 50, "n_initial_discard": 20},
}


@pytest.fixture(scope="module")
def identified(tmp_path_factory):
    """A working directory with the results of two good recordings around a bad one."""
    folder = tmp_path_factory.mktemp("batch")
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(folder)
        for number in (1, 3):
            record = armax(number, 500)[0]
            samples = np.column_stack([record.input, record.output])
            np.savetxt(f"{number}.csv", samples, delimiter=",")
        Path("2.csv").write_text("1,2\n")
        assert states(run(failing="r2")) == {"r1": "complete", "r2": "failed.", "r3": "complete"}
        identify_dataset(DatasetFiles("alone/r3"), recordings()["r3"], with_report=False)
    return folder


@pytest.fixture
def copied(identified, tmp_path, monkeypatch):
    """A copy as working directory, for a test to change."""
    shutil.copytree(identified, tmp_path / "copy", copy_function=shutil.copy2)
    monkeypatch.chdir(tmp_path / "copy")


def recordings(**keys):
    datasets = {f"r{n}": {"file": f"{n}.csv", "sampling_rate": 100} for n in (1, 2, 3)}
    return complete({"datasets": datasets, "defaults": DEFAULTS | keys}).datasets


def run(failing=""):
    """The lines of a batch, which fails where a recording does."""
    lines = []
    with pytest.raises(InputError, match=f"1 of the 3 .*{failing}") if failing else nullcontext():
        identification.identify_batch("results", recordings(), "code", lines.append)
    return lines


def states(lines):
    return {line.split(": ")[0]: line.split(": ")[1].split()[0] for line in lines}


def test_a_recording_keeps_what_a_job_of_its_own_makes_in_nine_files(copied):
    made, alone = DatasetFiles("results/r3"), Path("alone/r3")
    kept = [path for path in Path(made.folder).rglob("*") if path.is_file()]
    assert len(kept) == 9
    contents = {path.relative_to(made.folder).as_posix(): path.read_bytes() for path in kept}
    with zipfile.ZipFile(made.details) as packed:
        contents |= {name: packed.read(name) for name in packed.namelist()}
    for path in alone.rglob("*.*"):
        assert contents[path.relative_to(alone).as_posix()] == path.read_bytes(), path
    lines = Path(made.checksums).read_text().splitlines()
    assert len(lines) == 7
    for checksum, name in (line.split("  ") for line in lines):
        assert hashlib.sha256(contents[name]).hexdigest() == checksum


def test_a_bad_recording_has_its_own_sentence_and_no_results(copied):
    files = DatasetFiles("results/r2")
    assert "2.csv" in Path(files.log("identification")).read_text()
    assert not Path(files.summary).exists()


@pytest.mark.parametrize(
    ("change", "again"),
    [
        ("nothing", set()),
        ("the recording", {"r3"}),
        ("a result", {"r3"}),
        ("the archive", {"r3"}),
        ("the recording is gone", set()),
        ("it was killed", {"r3"}),
        ("the settings", {"r1", "r3"}),
        ("the code", {"r1", "r3"}),
    ],
)
def test_what_is_finished_is_not_done_again(copied, change, again):
    files, keys, code = DatasetFiles("results/r3"), {}, "code"
    match change:
        case "the recording":
            Path("3.csv").write_text(Path("3.csv").read_text().replace("1", "2"))
        case "a result":
            Path(files.model).write_text(Path(files.model).read_text() + " ")
        case "the archive":
            Path(files.details).unlink()
        case "the recording is gone":
            Path("3.csv").unlink()
        case "it was killed":
            UnfinishedJob("identification", ()).save(files.logs)
        case "the settings":
            keys = {"spectrum": {"nfft": 512}}
        case "the code":
            code = "other"
    unfinished = {
        name
        for name, settings in recordings(**keys).items()
        if not is_finished(DatasetFiles(f"results/{name}"), settings, code)
    }
    assert unfinished == again | {"r2"}


def test_an_interrupted_batch_goes_on_and_a_killed_recording_is_tried_last(copied, monkeypatch):
    shutil.rmtree("results/r3")
    Path("2.csv").write_text(Path("1.csv").read_text())
    UnfinishedJob("identification", ()).save(DatasetFiles("results/r2").logs)
    real, begun = identification.identify_dataset, []

    def interrupted(files, *arguments, **keys):
        begun.append(files.name)
        if files.name == "r2":
            raise KeyboardInterrupt
        real(files, *arguments, **keys)

    monkeypatch.setattr(identification, "identify_dataset", interrupted)
    with pytest.raises(KeyboardInterrupt):
        run()
    assert begun == ["r3", "r2"]
    monkeypatch.setattr(identification, "identify_dataset", real)
    assert states(run()) == {"r1": "finished", "r3": "finished", "r2": "complete"}
    alone = Path("alone/r3/model.json").read_bytes()
    assert Path("results/r3/model.json").read_bytes() == alone


def test_the_job_of_a_batch_is_forgotten_where_a_result_is_missing_or_a_file_replaced(copied):
    output, datasets = Path("results/checksums/batches/1.sha256"), recordings()
    datasets.pop("r2")
    batches = {"1": ("r1", "r3")}

    def is_kept():
        output.parent.mkdir(parents=True, exist_ok=True)
        output.touch()
        forget_incomplete_batches(batches, datasets)
        return output.exists()

    assert is_kept()
    os.utime("3.csv", (1, 1))  # the content is the same
    assert is_kept()
    Path("3.csv").write_text(Path("1.csv").read_text())
    os.utime("3.csv", (1, 1))
    assert not is_kept()
    Path("3.csv").unlink()
    assert is_kept()
    Path("results/r1/modes.csv").unlink()
    assert not is_kept()
