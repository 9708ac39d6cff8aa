"""The configuration: completed where it is right, refused in one sentence where it is not."""

from pathlib import Path

import pytest
import yaml

from evopem.config.defaults import complete
from evopem.config.strict_yaml import check_yaml_files
from evopem.errors import InputError

SCHEMA = Path(__file__).parents[2] / "workflow" / "schemas" / "config.schema.yaml"


def completed(text):
    return complete(yaml.safe_load(text), SCHEMA)


def refusal(text):
    with pytest.raises(InputError) as caught:
        completed(text)
    sentence = str(caught.value)
    assert sentence.count("\n") == 0
    assert sentence.endswith(".")
    return sentence


def test_only_datasets_is_a_complete_configuration():
    config = completed("datasets: {arm: {synthesis: flexible_arm}}")
    assert config == {
        "candidates_per_job": "auto",
        "one_job_per": "stage",
        "report": "html",
        "share": None,
        "fletcher_powell": {
            "algorithms": config["fletcher_powell"]["algorithms"],
            "dimension": 20,
            "evaluations": 200000,
            "instances": 10,
            "runs": 10,
            "slow_runs": 2,
            "scale": {"dimensions": [5, 10, 20, 40, 70, 100], "runs": 2},
            "runs_per_job": 10,
            "seed": 1,
        },
        "datasets": {
            "arm": {
                "synthesis": "flexible_arm",
                "seed": 1,
                "samples": 5000,
                "sampling_rate": 100,
                "resample": "none",
                "stationarity": {"box_cox": 1.1, "difference": 2, "difference_input": 0},
                "split": {"discard": 500, "estimation": 0.8},
                "spectrum": {"time_halfbandwidth": 4, "nfft": 8192},
                "delay": {"orders": [6, 9], "delays": [0, 3]},
                "orders": {"common": [6, 14], "c": [2, 16], "b": [2, 16]},
                "search": config["datasets"]["arm"]["search"],
            }
        },
    }
    search = config["datasets"]["arm"]["search"]
    assert (
        search.items()
        >= {
            "objective": "absolute",
            "mu": 15,
            "lambda": 100,
            "nu": 10,
            "start": "chapter",
            "mutate": "worst",
            "seed": 1,
        }.items()
    )


def test_a_file_needs_no_other_key():
    dataset = completed("datasets: {bench: {file: bench.csv}}")["datasets"]["bench"]
    assert dataset["input"] == 1
    assert dataset["output"] == 2
    assert dataset["sampling_rate"] is None


def test_own_keys_go_before_defaults_and_these_before_built_in_values():
    config = completed(
        """
        defaults: {search: {mu: 5, lambda: 50}, spectrum: {nfft: 1024}}
        datasets:
          one: {synthesis: armax, search: {mu: 7}}
          two: {synthesis: armax}
        """
    )["datasets"]
    assert (config["one"]["search"]["mu"], config["two"]["search"]["mu"]) == (7, 5)
    assert config["one"]["search"]["lambda"] == 50
    assert config["one"]["search"]["nu"] == 10
    assert config["one"]["spectrum"] == {"time_halfbandwidth": 4, "nfft": 1024}


def test_the_order_of_keys_and_the_way_numbers_are_written_do_not_count():
    one = completed("datasets: {a: {synthesis: armax, search: {mu: 7, seed: 3}, resample: 50}}")
    two = completed("datasets: {a: {resample: 50.0, search: {seed: 3.0, mu: 7}, synthesis: armax}}")
    assert repr(one) == repr(two)


def test_an_independent_recording_leaves_all_samples_for_estimation():
    text = "datasets: {a: {file: a.csv, validation_file: b.csv}}"
    assert completed(text)["datasets"]["a"]["split"]["estimation"] == 1.0
    fraction = f"{{defaults: {{split: {{estimation: 0.5}}}}, {text}}}"
    assert completed(fraction)["datasets"]["a"]["split"]["estimation"] == 0.5


def test_all_samples_are_not_one_sample():
    text = "datasets: {a: {file: a.csv, validation_file: b.csv, split: {estimation: %s}}}"
    assert repr(completed(text % "1.0")["datasets"]["a"]["split"]["estimation"]) == "1.0"
    assert repr(completed(text % "1")["datasets"]["a"]["split"]["estimation"]) == "1"


ARM = "datasets: {arm: {synthesis: armax, %s}}"
FILE = "datasets: {arm: {file: x.csv, %s}}"


@pytest.mark.parametrize(
    ("text", "place", "said"),
    [
        ("{}", "config.yaml", "the key datasets is missing"),
        ("datasets: {}", "datasets", "nothing in it"),
        ("datasets: 3", "datasets", "3 cannot be used"),
        ("datasets: {arm: }", "datasets.arm", "there is no value"),
        ("dataset: {arm: {file: x}}", "dataset", "did you mean datasets?"),
        ("datasets: {arm: {seed: 1}}", "datasets.arm", "file and synthesis are both missing"),
        (FILE % "synthesis: armax", "datasets.arm", "file and synthesis are both given"),
        (FILE % "seed: 2", "datasets.arm.seed", "a synthetic data set"),
        (ARM % "output: 2", "datasets.arm.output", "a recorded data set"),
        (FILE % "Sampling_Rate: 1", "datasets.arm.Sampling_Rate", "did you mean sampling_rate?"),
        (FILE % "sampling_rate: 1, time: t", "datasets.arm", "give one of the two"),
        (FILE % "sampling_rate: 0", "datasets.arm.sampling_rate", "0 is not above 0"),
        (FILE % "input: 2", "datasets.arm.output", "2 is both input and output"),
        (FILE % "input: 0", "datasets.arm.input", "0 is below 1"),
        ("datasets: {arm: {file: 'x{1}.csv'}}", "datasets.arm.file", "the braces in x{1}.csv"),
        (FILE % "validation_file: x.csv", "datasets.arm.validation_file", "x.csv is also"),
        (
            "datasets: {arm: {synthesis: flexible_arm, noise: 1}}",
            "datasets.arm.noise",
            "an armax data set",
        ),
        ("datasets: {arm: {synthesis: flexible}}", "arm.synthesis", "did you mean flexible_arm?"),
        (ARM % "samples: 5000.5", "datasets.arm.samples", "5000.5 cannot be used"),
        (ARM % "resample: 0", "datasets.arm.resample", "0 is not above 0"),
        (ARM % "resample: nine", "datasets.arm.resample", "nine is not known"),
        (ARM % "stationarity: {box_cox: .nan}", "stationarity.box_cox", "nan is not a finite"),
        (ARM % "stationarity: {box_cox: aut}", "stationarity.box_cox", "did you mean auto?"),
        (ARM % "stationarity: {difference: 9}", "stationarity.difference", "9 is above 4"),
        (ARM % "split: {estimation: 1.5}", "datasets.arm.split.estimation", "1.5 is neither"),
        (ARM % "split: {estimation: 1.0}", "datasets.arm.split.estimation", "takes all samples"),
        (ARM % "split: {discard: -1}", "datasets.arm.split.discard", "-1 is below 0"),
        (ARM % "spectrum: {nfft: 8}", "datasets.arm.spectrum.nfft", "8 is below 16"),
        (ARM % "delay: {order: [6, 9]}", "datasets.arm.delay.order", "did you mean orders?"),
        (ARM % "delay: {orders: [9, 6]}", "datasets.arm.delay.orders", "write [6, 9]"),
        (ARM % "delay: {orders: [6]}", "datasets.arm.delay.orders", "[6] holds 1 value"),
        (ARM % "delay: {orders: []}", "datasets.arm.delay.orders", "[] holds 0 values"),
        (ARM % "orders: {b: [2, 99]}", "datasets.arm.orders.b[1]", "99 is above 60"),
        (ARM % "delay: {orders: [6, x]}", "datasets.arm.delay.orders[1]", "x cannot be used"),
        (ARM % "orders: {common: autoo}", "datasets.arm.orders.common", "did you mean auto?"),
        (ARM % "orders: {c: auto}", "datasets.arm.orders.c", "auto cannot be used"),
        (ARM % "search: ", "datasets.arm.search", "there is no value"),
        (ARM % "search: {mutate: wurst}", "datasets.arm.search.mutate", "did you mean worst?"),
        (ARM % "search: {objective: abs}", "datasets.arm.search.objective", "abs is not known"),
        (ARM % "search: {nu: 200}", "datasets.arm.search.nu", "nu is 200 and lambda is 100"),
        (ARM % "search: {lambda: 12}", "datasets.arm.search.lambda", "mu is 15 and lambda is 12"),
        (ARM % "search: {seed: -1}", "datasets.arm.search.seed", "-1 is below 0"),
        (ARM % "search: {evaluations: 1e5}", "arm.search.evaluations", "YAML reads 1e5 as text"),
        (ARM % "search: {max_root_radius: 1}", "search.max_root_radius", "1 is not below 1"),
        ("{datasets: {a: {file: x}}, defaults: {file: x}}", "defaults.file", "no such key"),
        (
            "{datasets: {a: {file: x}}, defaults: {search: {lambda: 5}}}",
            "defaults.search.lambda",
            "lambda is 5",
        ),
        ("{datasets: {a: {file: x}}, candidates_per_job: 0}", "candidates_per_job", "below 1"),
        ("{datasets: {a: {file: x}}, candidates_per_job: aut}", "per_job", "did you mean auto?"),
        ("{datasets: {a: {file: x}}, share: 5/4}", "share", "there is no share 5/4"),
        ("datasets: [arm]", "datasets", "[arm] cannot be used"),
        ("datasets: absent.csv", "absent.csv", "there is no such table"),
        ("datasets: {'b-*': {file: x.csv}}", "datasets.b-*", "all files of a pattern"),
        ("datasets: {'*': {file: 'absent/*.csv'}}", "datasets.*.file", "no file matches"),
        ("datasets: {'../x': {synthesis: armax}}", "datasets", "'../x' cannot be the name"),
        ("datasets: {'a..b': {synthesis: armax}}", "datasets", "'a..b' cannot be the name"),
        ("datasets: {a/b: {synthesis: armax}}", "datasets", "'a/b' cannot be the name"),
        ("datasets: {two words: {synthesis: armax}}", "datasets", "'two words' cannot be"),
        ("datasets: {Größe: {synthesis: armax}}", "datasets", "'Größe' cannot be the name"),
        ("datasets: {.hidden: {synthesis: armax}}", "datasets", "'.hidden' cannot be the name"),
        ("datasets: {end.: {synthesis: armax}}", "datasets", "'end.' cannot be the name"),
        ("datasets: {'': {synthesis: armax}}", "datasets", "'' cannot be the name"),
        ("datasets: {seals: {synthesis: armax}}", "datasets", "seals is the name of something"),
        ("datasets: {Logs: {synthesis: armax}}", "datasets", "Logs is the name of something else"),
        ("datasets: {A: {file: x}, a: {file: x}}", "datasets", "A and a are one folder"),
    ],
)
def test_refusals_name_the_key_and_say_what_is_wrong(text, place, said):
    sentence = refusal(text)
    assert said in sentence
    assert place in sentence
    assert "; " in sentence, "a remedy follows the problem"


@pytest.mark.parametrize(
    ("text", "line", "said"),
    [
        ("a: 1\na: 2\n", "line 2", "the key a stands here for the second time"),
        ("datasets:\n  x: {seed: 1,\n    seed: 2}\n", "line 3", "seed stands here"),
        ("on: 1\n", "line 1", "the key on is read as true"),
        ("datasets:\n  2020: {}\n", "line 2", "is read as 2020"),
        ("a: [1\nb: 2\n", "line 2", "this is not YAML"),
        ("a:\n\tb: 1\n", "line 2", "this is not YAML"),
        ("", "config.yaml", "there are no keys"),
    ],
)
def test_yaml_that_would_hide_something_is_refused(tmp_path, text, line, said):
    path = tmp_path / "config.yaml"
    path.write_text(text, encoding="utf-8")
    with pytest.raises(InputError) as caught:
        check_yaml_files([path])
    assert line in str(caught.value)
    assert said in str(caught.value)
    assert "\n" not in str(caught.value)


def test_sound_files_and_missing_ones_pass(tmp_path):
    path = tmp_path / "config.yaml"
    path.write_text("base: &x {a: 1}\ndatasets: {one: {<<: *x, b: 2}}\n", encoding="utf-8")
    check_yaml_files([path, tmp_path / "missing.yaml"])
