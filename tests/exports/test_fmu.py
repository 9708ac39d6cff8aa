"""Exported FMUs are valid by FMPy, which simulates what Python does."""

import shutil
import subprocess
import zipfile

import numpy as np
import pytest
from random_models import random_record
from test_c_code import SAMPLES, signals_of, simulated_in_python

from evopem import PolynomialModel, export_fmu
from evopem.errors import InputError
from evopem.files.json_form import save
from evopem.terminal.command import main

FLAGS = ("-std=c99", "-Wall", "-Wextra", "-Wconversion", "-Wfloat-equal", "-pedantic", "-Werror")
NAME = "x.fmu"


@pytest.fixture
def fmpy():
    return pytest.importorskip("fmpy", reason="FMPy is not installed: make .venv/installed-dev")


@pytest.fixture
def exported(identified, tmp_path, monkeypatch):
    """Write the FMU of a random model, and give its record."""
    monkeypatch.chdir(tmp_path)

    def export(number):
        record = random_record(identified.results.model, number)
        save(record, "arm.json")
        assert main(["export", "arm.json", "--fmu", NAME]) == 0
        return record

    return export


# Every structure with an input, delays and feedthrough, one and several outputs, every transform.
@pytest.mark.parametrize("number", [9, 10, 11, 13, 14, 17, 18, 19, 22, 29, 33, 34])
def test_an_fmu_is_valid_and_simulates_what_python_does(exported, fmpy, tmp_path, number):
    """Inputs of a sample are set before its outputs are read."""
    from fmpy.fmi3 import FMU3Slave
    from fmpy.validation import validate_fmu

    record = exported(number)
    assert validate_fmu(NAME) == []
    about = fmpy.read_model_description(NAME)
    inputs, outputs = (
        [each for each in about.modelVariables if each.causality == kind]
        for kind in ("input", "output")
    )
    assert [each.name for each in outputs] == list(record.output_names)
    assert {each.unit for each in inputs} == {"N m"}
    assert about.coSimulation.fixedInternalStepSize == "0.02"
    u, _ = signals_of(record, number)
    unit = FMU3Slave(
        guid=about.instantiationToken,
        unzipDirectory=fmpy.extract(NAME, str(tmp_path / "unit")),
        modelIdentifier=about.coSimulation.modelIdentifier,
        instanceName="one",
    )
    unit.instantiate()
    start = float(about.defaultExperiment.startTime)
    unit.enterInitializationMode(startTime=start)
    unit.exitInitializationMode()
    found = []
    begin = unit.getFMUState()
    unit.doStep(start, 0.02)  # what is taken back
    unit.setFMUState(begin)
    unit.freeFMUState(begin)
    for t in range(SAMPLES):
        unit.setFloat64([each.valueReference for each in inputs], u[t])
        found.append(unit.getFloat64([each.valueReference for each in outputs]))
        unit.doStep(start + 0.02 * t, 0.02)
    unit.terminate()
    unit.freeInstance()
    expected = simulated_in_python(record, u)
    scale = np.nanmax(np.abs(expected))
    np.testing.assert_allclose(found, expected, rtol=0.0, atol=1e-12 * scale)


def test_fmpy_simulates_a_delayed_model_by_itself(fmpy, tmp_path):
    model = PolynomialModel([1.0, -1.2, 0.8], [0.5, 0.1], nk=1, sampling_rate=50.0, level=0.2)
    export_fmu(model, tmp_path / NAME)
    u, times = np.random.default_rng(1).standard_normal(200), np.arange(200) / 50.0
    kinds = [("time", float), ("input 1", float)]
    signals = np.array([*zip(times, u, strict=True)], dtype=kinds)
    found = fmpy.simulate_fmu(str(tmp_path / NAME), stop_time=times[-1], input=signals)
    np.testing.assert_allclose(found["output 1"], model.simulate(u), rtol=0.0, atol=1e-11)


def test_the_source_compiles_without_a_warning(exported, tmp_path):
    if shutil.which("cc") is None:
        pytest.skip("there is no C compiler, cc")
    exported(30)
    with zipfile.ZipFile(NAME) as archive:
        archive.extractall()
        names = archive.namelist()
    assert {"modelDescription.xml", "sources/arm.c", "sources/buildDescription.xml"} <= {*names}
    command = ["cc", *FLAGS, "-c", "arm.c", "fmi3.c"]
    subprocess.run(command, cwd=tmp_path / "sources", check=True)
    # Neither variables of the file nor memory that is asked for.
    run = subprocess.run(["nm", "sources/arm.o"], capture_output=True, text=True, check=True)
    kinds = {line.split()[-2]: line.split()[-1] for line in run.stdout.splitlines()}
    assert {*kinds} <= {"T", "t", "r", "U"}
    assert "alloc" not in run.stdout


def test_a_step_of_another_length_is_an_error(exported, fmpy):
    exported(29)
    with pytest.raises(Exception, match="fmi3DoStep"):
        fmpy.simulate_fmu(NAME, stop_time=0.3, output_interval=0.03)


def test_without_a_compiler_the_source_alone_is_written(exported, monkeypatch, capsys):
    monkeypatch.setenv("PATH", "")
    exported(29)
    assert capsys.readouterr().out == "Wrote x.fmu without a binary: there is no C compiler, cc.\n"
    with zipfile.ZipFile(NAME) as archive:
        assert not [name for name in archive.namelist() if name.startswith("binaries")]


def test_other_files_are_not_replaced(exported, tmp_path):
    exported(29)
    exported(30)  # one of evopem is
    (tmp_path / NAME).write_bytes(b"PK\x03\x04 of another program")
    model = PolynomialModel([1.0], [0.5])
    with pytest.raises(InputError, match=r"x\.fmu: is no FMU of evopem and is not replaced"):
        export_fmu(model, NAME)
    with pytest.raises(InputError, match="has no input"):
        export_fmu(PolynomialModel([1.0, -0.5], []), "y.fmu")
