"""Whole runs: what they make, what they make again, and what they survive."""

import copy as copies
import csv
import json
import os
import shutil
import signal
import time

import pytest

from .conftest import ROOT, TINY, Folder
from .interruption import final_files

PROMISED = (
    "config.yaml",
    "recording.json",
    "transforms.json",
    "truth.json",
    "spectrum.csv",
    "spectrum.json",
    "candidates.csv",
    "model.json",
    "model.mat",
    "modes.csv",
    "frequency_response.csv",
    "validation.json",
    "residual_autocorrelation.csv",
    "cross_correlation.csv",
    "simulation.csv",
    "summary.json",
    "report.html",
)


def read_table(path):
    with path.open(encoding="utf-8") as stream:
        return list(csv.DictReader(stream))


def changed(path, value, config=TINY):
    """The tiny configuration with one key of its defaults changed."""
    config = copies.deepcopy(config)
    *steps, last = path.split(".")
    place = config
    for step in steps:
        place = place.setdefault(step, {})
    place[last] = value
    return config


def test_a_run_makes_every_promised_file(finished):
    results = finished.results / "truth"
    for name in PROMISED:
        assert (results / name).stat().st_size > 0, name
    model = json.loads((results / "model.json").read_text())
    orders = model["orders"]
    assert len(model["a"]) == orders["na"] + 1
    assert len(model["b"]) == orders["nb"]
    assert len(model["c"]) == orders["nc"] + 1
    chosen = {
        row["phase"]: row
        for row in read_table(results / "candidates.csv")
        if row["selected"] == "True"
    }
    assert list(chosen) == ["delay", "common", "c", "b"]
    assert {key: int(chosen["b"][key]) for key in orders} == orders
    assert model["scoring_start"] == 4 + 3 - 1 + 20


def test_a_run_leaves_no_unfinished_files(finished):
    assert not [path for path in finished.results.rglob("*") if path.name.startswith(".")]
    assert not list(finished.results.rglob("*.partial"))


def test_the_kept_configuration_is_the_same_run(finished, folder):
    shutil.copy(finished.results / "truth" / "config.yaml", folder.path)
    shutil.copytree(finished.results, folder.results)
    shutil.copytree(finished.path / ".snakemake", folder.path / ".snakemake")
    assert "fit_candidates" not in folder.planned("--config", "candidates_per_job=2")


def test_a_second_run_does_nothing(copy):
    assert "Nothing to be done" in copy.finish("--cores", "1")


def test_touched_files_rerun_nothing(copy):
    for path in copy.results.rglob("*"):
        if path.suffix in {".npz", ".json"}:
            path.touch()
    assert copy.planned() == {}


def test_a_fresh_checkout_reruns_nothing(copy, tmp_path):
    checkout = tmp_path / "checkout"
    shutil.copytree(
        ROOT,
        checkout,
        ignore=shutil.ignore_patterns(".*", "results", "__pycache__", "tests"),
        copy_function=shutil.copy,
    )
    assert Folder(copy.path, checkout / "Snakefile").planned() == {}


@pytest.mark.parametrize(
    ("module", "rerun", "untouched"),
    [
        ("signals/spectrum.py", {"estimate_spectrum"}, {"prepare_signals", "fit_candidates"}),
        ("figures/style.py", {"draw_figures"}, {"estimate_spectrum", "validate_model"}),
        ("validation/scores.py", {"validate_model"}, {"fit_candidates", "complete_model"}),
        (
            "estimation/pem/kernels/gradient.py",
            {"fit_candidates"},
            {"prepare_signals", "estimate_spectrum"},
        ),
        ("../fit_candidates.py", {"fit_candidates"}, {"prepare_signals", "estimate_spectrum"}),
        ("../../templates/report.html.j2", {"write_report"}, {"draw_figures", "fit_candidates"}),
    ],
)
def test_changed_code_reruns_what_uses_it(copy, tmp_path, module, rerun, untouched):
    checkout = tmp_path / "checkout"
    shutil.copytree(
        ROOT, checkout, ignore=shutil.ignore_patterns(".*", "results", "__pycache__", "tests")
    )
    changed_file = checkout / "workflow" / "scripts" / "evopem" / module
    changed_file.write_text(changed_file.read_text() + "\n# changed\n")
    planned = set(Folder(copy.path, checkout / "Snakefile").planned())
    assert rerun <= planned
    assert not untouched & planned


FROM_SPECTRUM = {"estimate_spectrum", "summarize_data_set", "draw_figures", "write_report"}
FROM_MODEL = {
    "complete_model",
    "validate_model",
    "summarize_data_set",
    "draw_figures",
    "write_report",
}
FROM_SELECTION = {"select_candidate", "tabulate_candidates", *FROM_MODEL}
FROM_FITS = {"fit_candidates", *FROM_SELECTION}


@pytest.mark.parametrize(
    ("key", "value", "rules"),
    [
        ("defaults.spectrum.nfft", 1024, FROM_SPECTRUM),
        ("defaults.search.seed", 2, FROM_FITS),
        ("defaults.orders.b", [2, 3], FROM_FITS),
        (
            "defaults.split.discard",
            30,
            {"prepare_signals", *FROM_SPECTRUM, *FROM_FITS},
        ),
        (
            "datasets.truth.seed",
            2,
            {"synthesize_recording", "prepare_signals", *FROM_SPECTRUM, *FROM_FITS},
        ),
    ],
)
def test_a_changed_value_reruns_what_depends_on_it(copy, key, value, rules):
    copy.configure(changed(key, value))
    assert set(copy.planned()) == rules | {"write_configuration"}


def test_a_changed_range_of_the_last_phase_leaves_the_earlier_ones(copy):
    copy.configure(changed("defaults.orders.b", [2, 3]))
    planned = copy.planned()
    assert planned["fit_candidates"] == 1
    assert planned["select_candidate"] == 1


def test_another_data_set_leaves_the_first_alone(copy):
    copy.configure(changed("datasets.other", {"synthesis": "armax", "samples": 800}))
    planned = copy.planned()
    assert planned.pop("collect_fleet") == 1
    assert planned["fit_candidates"] == 4
    assert planned["synthesize_recording"] == 1


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


def test_cores_parts_and_surroundings_do_not_change_results(finished, tmp_path):
    """In other parts, on two cores, with another locale, time zone, hash seed and BLAS threads.

    And with numpy's code for a processor without AVX-512.
    """
    folder = Folder(tmp_path, environment=ELSEWHERE)
    folder.configure(changed("candidates_per_job", 1))
    assert folder.planned()["fit_candidates"] == 7
    folder.finish("--cores", "2")
    expected, found = (
        {name: content for name, content in final_files(each).items() if "phases/" not in name}
        for each in (finished, folder)
    )
    assert sorted(found) == sorted(expected)
    assert [name for name in found if found[name] != expected[name]] == []
    assert {"truth/model.json", "truth/candidates.csv", "truth/figures/phases.svg"} <= set(found)


def test_a_killed_run_is_taken_up_again(copy, finished):
    model = (finished.results / "truth" / "model.json").read_bytes()
    shutil.rmtree(copy.results / "truth" / "phases")
    (copy.results / "truth" / "model.json").unlink()
    kept = (copy.results / "truth" / "recording.npz").stat().st_mtime_ns
    run = copy.start("--cores", "1")
    deadline = time.monotonic() + 120
    while not (copy.results / "truth" / "phases" / "common.json").exists():
        assert time.monotonic() < deadline, "the run did not come as far as it should"
        assert run.poll() is None, "the run ended before it could be killed"
        time.sleep(0.05)
    os.killpg(run.pid, signal.SIGKILL)
    run.wait()
    assert not (copy.results / "truth" / "model.json").exists()
    first = (copy.results / "truth" / "phases" / "delay.json").stat().st_mtime_ns
    copy.finish("--unlock")
    copy.finish("--cores", "1")
    assert (copy.results / "truth" / "model.json").read_bytes() == model
    assert (copy.results / "truth" / "recording.npz").stat().st_mtime_ns == kept
    assert (copy.results / "truth" / "phases" / "delay.json").stat().st_mtime_ns == first


def test_a_recorded_file_in_a_folder_of_ones_own(finished, folder):
    """One entry under `datasets:` is all that a recording needs."""
    import numpy as np

    with np.load(finished.results / "truth" / "recording.npz") as stored:
        table = np.column_stack([stored["output"], stored["input"]])
    (folder.path / "my data").mkdir()
    np.savetxt(
        folder.path / "my data" / "bench 1.csv",
        table,
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
    folder.finish("--cores", "2", "--until", "complete_model", "--directory", ".")
    results = folder.results / "bench-1.a"
    origin = json.loads((results / "recording.json").read_text())
    assert origin["path"] == "my data/bench 1.csv"
    assert (origin["kind"], origin["samples"], origin["output_unit"]) == ("file", 700, "m/s2")
    assert json.loads((results / "model.json").read_text())["sampling_rate"] == 50
    assert not (results / "truth.json").exists()


def test_a_report_of_snakemakes_own(copy):
    copy.finish("--report", "snakemake-report.zip")
    assert (copy.path / "snakemake-report.zip").stat().st_size > 0
