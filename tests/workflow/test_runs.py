"""Whole runs: what they make, what they repeat, and what they survive."""

import copy as copies
import json
import os
import shutil
import signal
import time
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from evopem.config.settings import ScoringWindow
from evopem.config.structures import phases_of
from evopem.estimation.model_record import ModelRecord
from evopem.files.json_form import load
from evopem.results.layout import DatasetFiles
from evopem.signals.recording_info import RecordingInfo

from .conftest import TINY, Folder, checkout_at, jobs_of_each_rule
from .interruption import final_files

PHASES = phases_of("armax")


def changed(path, value, config=TINY):
    """The tiny configuration with one key changed."""
    config = copies.deepcopy(config)
    *steps, last = path.split(".")
    place = config
    for step in steps:
        place = place.setdefault(step, {})
    place[last] = value
    return config


def test_a_run_makes_every_promised_file(finished):
    files = finished.files_of("truth")
    promised = [name for name, each in vars(DatasetFiles).items() if type(each).__name__ == "_File"]
    of_others = {"validation_recording", "validation_recording_info", "decisions", "details"}
    of_others |= {"varying", "varying_modes"}
    for name in {*promised, "figures"} - of_others:
        paths = getattr(files, name)
        for path in map(Path, paths if isinstance(paths, list) else [paths]):
            assert path.stat().st_size > 0, path
    record = load(ModelRecord, files.model)
    orders = record.orders
    assert len(record.polynomials.A) == orders.na + 1
    assert len(record.polynomials.B[0]) == orders.single.nb
    assert len(record.polynomials.C) == orders.nc + 1
    candidates = pd.read_csv(files.candidates)
    selected = candidates[candidates["selected"]].set_index("phase")
    assert list(selected.index) == list(PHASES)
    columns = ["na", "nb", "nc", "nk"]
    assert selected.loc["nb", columns].tolist() == [
        orders.na,
        orders.single.nb,
        orders.nc,
        orders.single.nk,
    ]
    assert record.window == ScoringWindow(4 + 3 - 1, 4 + 3 - 1 + 20)
    counts = candidates.groupby("phase").size()
    assert counts[["delay", "plant", "nc"]].tolist() == [3, 2, 2]
    assert counts["nb"] >= 1  # and those with which the delay is refined


def test_a_run_leaves_no_unfinished_files(finished):
    """Neither temporary files, which are hidden, nor records of unfinished jobs."""
    assert not [path for path in finished.results.rglob("*") if path.name.startswith(".")]
    assert not list(finished.results.rglob("*unfinished*"))


def test_a_second_run_repeats_nothing(copy, tmp_path):
    """Not even from a fresh clone, with results that were touched."""
    for path in copy.results.rglob("*"):
        if path.suffix in {".npz", ".json"}:
            path.touch()
    clone = checkout_at(tmp_path / "clone")
    assert Folder(copy.path, clone / "Snakefile").planned() == {}


def test_the_kept_configuration_is_the_same_run(copy):
    shutil.copy(copy.files_of("truth").config, copy.path)
    assert copy.planned("--config", "candidates_per_job=2") == {}


def test_changed_code_repeats_what_uses_it(copy, tmp_path):
    """Which scripts a module belongs to is tested in tests/config/test_rule_digest.py."""
    clone = checkout_at(tmp_path / "clone")
    tables = clone / "workflow" / "scripts" / "evopem" / "validation" / "tables.py"
    tables.write_text(tables.read_text() + "\n# changed\n")
    template = clone / "workflow" / "templates" / "report.html.j2"
    template.write_text(template.read_text() + "<!-- changed -->\n")
    planned = set(Folder(copy.path, clone / "Snakefile").planned())
    assert {"validate", "report"} <= planned
    untouched = {"prepare", "estimate_spectrum", "estimate_candidates", "complete_model"}
    assert not untouched & planned


FROM_SPECTRUM = {"estimate_spectrum", "validate", "report"}
FROM_MODEL = {"complete_model", "validate", "report"}
FROM_SELECTION = {"select_candidate", *FROM_MODEL}
FROM_CANDIDATES = {"estimate_candidates", *FROM_SELECTION}


@pytest.mark.parametrize(
    ("key", "value", "rules"),
    [
        ("defaults.spectrum.nfft", 1024, FROM_SPECTRUM),
        ("defaults.orders.nb", [2, 3], FROM_CANDIDATES),
    ],
)
def test_a_changed_value_repeats_what_depends_on_it(copy, key, value, rules):
    """Which stages other values repeat is tested in tests/pipeline/test_changed_keys.py."""
    copy.configure(changed(key, value))
    planned = copy.planned()
    assert set(planned) == rules
    if key == "defaults.orders.nb":  # of the last phase: the earlier ones stay
        assert planned["estimate_candidates"] == planned["select_candidate"] == 1


def test_another_data_set_leaves_the_first_alone(copy):
    copy.configure(changed("datasets.other", {"synthesis": "armax", "samples": 800}))
    planned = copy.planned()
    assert planned.pop("list_datasets") == 1
    assert planned["estimate_candidates"] == 5
    assert planned["synthesize"] == 1


ELSEWHERE = {
    "LC_ALL": "C",
    "LANG": "tr_TR.UTF-8",
    "TZ": "Pacific/Kiritimati",
    "PYTHONHASHSEED": "12345",
    "PYTHONUTF8": "0",
    "OPENBLAS_NUM_THREADS": "5",
    "OMP_NUM_THREADS": "5",
    "MKL_NUM_THREADS": "5",
    "NPY_DISABLE_CPU_FEATURES": "AVX512F AVX512_SKX AVX512_ICL AVX512_SPR",
    "COLUMNS": "40",
}


def test_neither_one_job_nor_cores_nor_environment_change_results(finished, tmp_path):
    """All stages in one job with three processes, as the run of a job for each stage made them.

    In another locale, time zone, hash seed and number of BLAS threads, and with numpy's code for a
    processor without AVX-512. Fewer cores in another environment later repeat nothing.
    """
    folder = Folder(tmp_path, environment=ELSEWHERE)
    folder.configure(TINY | {"one_job_per": "recording", "candidates_per_job": "auto"})
    printed = folder.finish("--cores", "3")
    assert jobs_of_each_rule(printed) == {"identification": 1}
    staged, made = (
        {name: content for name, content in final_files(each).items() if not _of_jobs(name)}
        for each in (finished, folder)
    )
    assert sorted(made) == sorted(staged)
    assert [name for name in made if made[name] != staged[name]] == []
    assert {"truth/model.json", "truth/candidates.csv", "truth/figures/phases.svg"} <= set(made)
    assert {f"truth/phases/{phase}.json" for phase in PHASES} <= set(made)
    assert Path(folder.files_of("truth").report).stat().st_size > 50_000
    here = Folder(tmp_path)
    assert here.planned("--cores", "1") == {}
    Path(folder.files_of("truth").phase("nc")).unlink()  # no other job of the run needs it
    assert here.planned() == {"identification": 1}


def _of_jobs(name):
    """Whether a file tells how the stages were divided into jobs."""
    return "/part-" in name or "/checksums/" in name


def test_a_killed_run_is_taken_up_again(copy, finished):
    files, expected = copy.files_of("truth"), finished.files_of("truth")
    for phase in ("plant", "nc", "nb"):
        Path(files.phase(phase)).unlink()
        Path(files.part(phase, 1)).unlink()
    Path(files.model).unlink()
    kept = Path(files.recording).stat().st_mtime_ns
    run = copy.start("--cores", "1", "results/truth/model.json")
    deadline = time.monotonic() + 120
    while not Path(files.phase("nc")).exists():
        assert time.monotonic() < deadline, "the run did not come as far as it should"
        assert run.poll() is None, "the run ended before it could be killed"
        time.sleep(0.05)
    os.killpg(run.pid, signal.SIGKILL)
    run.wait()
    assert not Path(files.model).exists()
    first = Path(files.phase("plant")).stat().st_mtime_ns
    copy.finish("--unlock")
    copy.finish("--cores", "1", "results/truth/model.json")
    assert Path(files.model).read_bytes() == Path(expected.model).read_bytes()
    assert Path(files.recording).stat().st_mtime_ns == kept
    assert Path(files.phase("plant")).stat().st_mtime_ns == first


def test_a_recorded_file_in_a_folder_of_ones_own(recorded, folder):
    """One entry under `datasets:` is all that a recording needs."""
    (folder.path / "my data").mkdir()
    np.savetxt(
        folder.path / "my data" / "bench 1.csv",
        recorded[:, ::-1],
        delimiter=",",
        header="acc,torque",
        comments="",
    )
    entry = {
        "file": "my data/bench 1.csv",
        "input": "torque",
        "output": "acc",
        "sampling_rate": 50,
        "output_unit": "m/s2",
    }
    folder.configure(TINY | {"datasets": {"bench-1.a": entry}})
    folder.finish("--cores", "2", "--until", "prepare", "--directory", ".")
    files = folder.files_of("bench-1.a")
    info = load(RecordingInfo, files.recording_info)
    assert info.files[0].path == "my data/bench 1.csv"
    assert (info.samples, info.outputs[0].unit) == (700, "m/s2")
    assert json.loads(Path(files.transforms).read_text())["sampling_rate"] == 50
    assert not Path(files.truth).exists()
