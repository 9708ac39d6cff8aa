"""Exported C compiles without a warning, and computes what Python does."""

import shutil
import subprocess
import sys
from dataclasses import replace

import numpy as np
import pytest
from random_models import random_record

from evopem.errors import InputError
from evopem.exports.c_code import export_c, identifier, plain
from evopem.files.json_form import save
from evopem.models.polynomial import PolynomialModel
from evopem.signals.prepared_data import measured_outputs
from evopem.signals.transforms import box_cox, difference, invert_difference
from evopem.terminal.command import main
from evopem.validation.responses import Responses
from evopem.validation.tables import recorded_series

MODELS = 52
SAMPLES = 80
FLAGS = (
    *("-std=c99", "-Wall", "-Wextra", "-Wconversion", "-Wfloat-equal", "-Werror"),
    *("-fsanitize=address,undefined", "-fno-sanitize-recover=all"),
)
DRIVER = """
static void run_NAME(void)
{
    double u[INPUTS + 1], y[NAME_OUTPUTS], simulated[NAME_OUTPUTS], predicted[NAME_OUTPUTS];
    SIMULATION
    NAME_prediction p;
    NAME_prediction_init(&p);
    for (int t = 0; t < SAMPLES; t++) {
        for (int i = 0; i < INPUTS; i++)
            if (scanf("%lf", &u[i]) != 1) exit(1);
        for (int j = 0; j < NAME_OUTPUTS; j++) {
            if (scanf("%lf", &y[j]) != 1) exit(1);
            simulated[j] = 0.0;
        }
        SIMULATE
        NAME_predict(&p, GIVEN predicted);
        NAME_update(&p, y);
        for (int j = 0; j < NAME_OUTPUTS; j++)
            printf("%.17g %.17g\\n", simulated[j], predicted[j]);
    }
}
"""


def driver(name, inputs):
    """A function in C that reads signals, simulates and predicts."""
    texts = {
        "SIMULATION": "NAME_simulation s; NAME_simulation_init(&s);" if inputs else "",
        "SIMULATE": "NAME_simulate(&s, u, simulated);" if inputs else "(void)u;",
        "GIVEN": "u," if inputs else "",
        "NAME_OUTPUTS": f"{name.upper()}_OUTPUTS",
        "INPUTS": str(inputs),
        "NAME": name,
        "SAMPLES": str(SAMPLES),
    }
    text = DRIVER.replace("NAME_OUTPUTS", texts.pop("NAME_OUTPUTS"))
    for key, value in texts.items():
        text = text.replace(key, value)
    return text


def signals_of(record, number):
    """Recorded inputs and outputs that fit the transforms."""
    generator = np.random.default_rng(1000 + number)
    u = generator.standard_normal((SAMPLES, record.model.inputs))
    y = generator.standard_normal((SAMPLES, record.model.outputs))
    if record.transforms.box_cox is not None:  # small, within the range of the transform
        return 0.05 * u, np.exp(0.1 * y)
    return u, y


def prepared(record, u, y):
    """Signals as the model sees them, from the sample on in which all differences are known."""
    about, (origin,) = record.transforms, record.transforms.estimation
    times = origin.start + np.arange(SAMPLES) / about.sampling_rate
    if about.has_trend:
        u, y = u - np.outer(times, about.input_trends), y - np.outer(times, about.output_trends)
    if about.box_cox is not None:
        y = box_cox(y, about.box_cox, about.shift)
    counts = about.difference_input if record.has_input else 0, about.difference
    lost = max(counts)
    if about.difference_pole:
        initial = origin.input_initial, origin.output_initial
        u, y = (
            filtered(each, first, about.difference_pole)[0][lost:]
            for each, first in zip((u, y), initial, strict=True)
        )
    else:
        u, y = (
            difference(each[lost - count :], count)[0]
            for each, count in zip((u, y), counts, strict=True)
        )
    return u - origin.input_means, y - origin.output_means, lost


def filtered(signals, initial, pole):
    """Behind a high-pass filter, sample by sample from an initial level on, and the second one."""
    levels = [np.array(initial[0])] if initial else [signals[0]]
    for sample in signals:
        levels.append(pole * levels[-1] + (1.0 - pole) * sample)
    return signals - levels[:-1], (tuple(levels[1].tolist()),)


def simulated_in_python(record, u):
    """The simulation of recorded inputs from rest, from where the estimation samples begin."""
    about, (origin,) = record.transforms, record.transforms.estimation
    times = origin.start + np.arange(SAMPLES) / about.sampling_rate
    if about.has_trend:
        u = u - np.outer(times, about.input_trends)
    if about.difference_pole:
        u = filtered(u, origin.input_initial, about.difference_pole)[0]
    else:
        before = invert_difference(np.empty((0, u.shape[1])), origin.input_initial)
        u = difference(np.vstack([before, u]), len(before))[0] if len(before) else u
    simulated = record.model.simulate(u - origin.input_means).reshape(len(u), -1)
    return measured_outputs(about, origin, simulated)[about.difference :]


def predicted_in_python(record, u, y):
    """One-step predictions of recorded outputs; NaN where the past is not known."""
    about, (origin,) = record.transforms, record.transforms.estimation
    inputs, outputs, lost = prepared(record, u, y)
    of_one = isinstance(record.model, PolynomialModel)
    predicted = record.model.predict(inputs, outputs[:, 0] if of_one else outputs)
    initial = difference(bent(about, y)[lost - about.difference :], about.difference)[1]
    if about.difference_pole:
        initial = filtered(y, origin.output_initial, about.difference_pole)[1]
    own = replace(origin, samples=len(outputs), output_initial=initial)
    responses = Responses(
        outputs, predicted.reshape(len(outputs), -1), *(outputs, outputs), np.ones(len(outputs))
    )
    series = recorded_series(replace(about, validation=(own,)), responses)
    return np.vstack([np.full((lost, y.shape[1]), np.nan), series.predicted])


def bent(about, y):
    return y if about.box_cox is None else box_cox(y, about.box_cox, about.shift)


@pytest.fixture(scope="module")
def compiler():
    found = shutil.which("cc")
    if found is None:
        pytest.skip("there is no C compiler, cc")
    return found


def test_c_computes_what_python_does(identified, compiler, tmp_path):
    records, given = [], []
    main = ["#include <stdio.h>", "#include <stdlib.h>"]
    for number in range(MODELS):
        record = random_record(identified.results.model, number)
        save(record, tmp_path / f"m{number}.json")
        export_c(tmp_path / f"m{number}.json", tmp_path)
        main += [f'#include "m{number}.h"', driver(f"m{number}", record.model.inputs)]
        records.append((record, *signals_of(record, number)))
        given.append(np.hstack(records[-1][1:]))
    calls = "".join(f"run_m{number}();" for number in range(MODELS))
    (tmp_path / "main.c").write_text("\n".join([*main, f"int main(void) {{ {calls} return 0; }}"]))
    sources = ["main.c", *(f"m{number}.c" for number in range(MODELS))]
    command = [compiler, *FLAGS, *sources, "-lm", "-o", "run"]
    subprocess.run(command, cwd=tmp_path, check=True)
    text = "\n".join(" ".join(map(repr, each.ravel().tolist())) for each in given)
    run = subprocess.run([tmp_path / "run"], input=text, capture_output=True, text=True, check=True)
    values = iter(np.array(run.stdout.split(), dtype=float))
    for number, (record, u, y) in enumerate(records):
        found = np.array([next(values) for _ in range(2 * y.size)]).reshape(*y.shape, 2)
        check(f"prediction {number}", found[..., 1], predicted_in_python(record, u, y))
        if record.has_input:
            check(f"simulation {number}", found[..., 0], simulated_in_python(record, u))


def check(name, found, expected):
    assert np.isfinite(expected).sum() > 10, name
    scale = np.nanmax(np.abs(expected))
    np.testing.assert_allclose(found, expected, rtol=0.0, atol=1e-12 * scale, err_msg=name)


@pytest.fixture
def model_file(tmp_path, monkeypatch):
    """The file of a small model, in the working folder."""
    monkeypatch.chdir(tmp_path)
    save(PolynomialModel([1.0, -0.5], [2.0], nk=1), "arm.json")
    return tmp_path


def test_files_are_named_after_results_and_purposes(identified, tmp_path):
    folder = tmp_path / "arm"
    folder.mkdir()
    for name, expected in (("model", "arm"), ("model.prediction", "arm_for_prediction")):
        shutil.copy(identified.files.model, folder / f"{name}.json")
        assert export_c(folder / f"{name}.json", tmp_path)[0].name == f"{expected}.c"


def test_the_command_writes_both_files(model_file, capsys):
    assert main(["export", "arm.json", "--c"]) == 0
    assert capsys.readouterr().out == "Wrote arm.c and arm.h, which says how it is called.\n"
    assert main(["export", "arm.json", "--c", "code"]) == 0  # again, and into a new folder
    assert (model_file / "code" / "arm.c").read_bytes() == (model_file / "arm.c").read_bytes()
    with pytest.raises(SystemExit):
        main(["export", "arm.json"])
    assert "give --c, --fmu or both" in capsys.readouterr().err


@pytest.mark.parametrize("name", ["arm.c", "arm.h"])
def test_no_file_of_another_program_is_replaced(model_file, capsys, name):
    (model_file / name).write_text("int main(void) { return 0; }\n")
    assert main(["export", "arm.json", "--c"]) == 1
    sentence = f"{name}: is no file of evopem and is not replaced; give another path.\n"
    assert capsys.readouterr().err == sentence
    assert sorted(path.name for path in model_file.iterdir()) == sorted(["arm.json", name])


@pytest.mark.parametrize(
    ("arguments", "sentence"),
    [
        (["none.json", "--c"], "none.json: cannot be read (No such file or directory); give"),
        (["arm.json", "--c", "arm.json"], "arm.json: is no folder; give"),
        (["arm.json", "--c", "arm.json/code"], "arm.json/code"),
        ([".", "--c"], ".: is no regular file; give the model.json of a results folder.\n"),
    ],
)
def test_what_cannot_be_exported_is_said_in_a_sentence(model_file, capsys, arguments, sentence):
    assert main(["export", *arguments]) == 1
    error = capsys.readouterr().err
    assert error.startswith(sentence)
    assert error.count("\n") == 1
    assert [path.name for path in model_file.iterdir()] == ["arm.json"]


def test_a_missing_package_is_named(model_file, capsys, monkeypatch):
    monkeypatch.setitem(sys.modules, "jinja2", None)
    assert main(["export", "arm.json", "--c"]) == 1
    assert "the exported files need jinja2, which is not installed" in capsys.readouterr().err


@pytest.mark.parametrize("delay", [-1, 10**9])
def test_delays_of_states_that_are_none_are_refused(identified, tmp_path, delay):
    record = random_record(identified.results.model, 9)
    model = replace(record.model, input_delays=(delay,) * record.model.inputs)
    save(replace(record, model=model), tmp_path / "arm.json")
    with pytest.raises(InputError, match="is none of 100 samples"):
        export_c(tmp_path / "arm.json", tmp_path)


def test_transforms_that_are_none_are_refused(identified, tmp_path):
    record = random_record(identified.results.model, 1)
    about, (origin,) = record.transforms, record.transforms.estimation
    for change, problem in (
        ({"output_means": (np.nan,)}, "a number of the model or its transforms is not finite"),
        ({"output_means": ()}, "the transforms do not fit the channels"),
        ({"output_initial": ()}, "the transforms do not fit the channels"),
    ):
        changed = replace(about, estimation=(replace(origin, **change),))
        save(replace(record, transforms=changed), tmp_path / "arm.json")
        with pytest.raises(InputError, match=problem):
            export_c(tmp_path / "arm.json", tmp_path)
    assert [path.name for path in tmp_path.iterdir()] == ["arm.json"]


@pytest.mark.parametrize(
    ("c", "sentence"),
    [
        ([1.0, -0.99], "Begin a prediction, from rest: what was before fades to 1 % in about 460 "),
        ([1.0, -1.0], "Begin a prediction, from rest: what was before does not fade."),
    ],
)
def test_the_header_says_how_long_the_past_is_felt(tmp_path, c, sentence):
    export_c(PolynomialModel([1.0, -0.5], [2.0], c, nk=1), tmp_path)
    header = (tmp_path / "model.h").read_text()
    assert sentence in header
    assert "Begin a simulation, from rest: what was before fades to 1 % in about 8 " in header


@pytest.mark.parametrize(
    ("text", "name"),
    [
        ("arm", "arm"),
        ("é-2 b", "model_2_b"),
        ("2", "model_2"),
        ("__", "model"),
        ("int", "int"),
        ("signal", "model_signal"),
    ],
)
def test_names_become_identifiers(text, name):
    assert identifier(text) == name


def test_no_name_of_a_channel_ends_a_comment():
    assert plain("a*/b/*c//d\nm/s**2*/*") == "a* /b/ *c//d m/s**2* / *"
