"""The configuration: completed where it is right, refused in one sentence where it is wrong."""

import pytest
import yaml

from evopem.config.channels import ChannelSettings, RecordedSource, SyntheticSource
from evopem.config.configuration import Configuration, RunSettings
from evopem.config.defaults import complete
from evopem.config.settings import (
    AutomaticSettings,
    DatasetSettings,
    OrderGrid,
    OrderRanges,
    PreparationSettings,
    SearchSettings,
    SpectrumSettings,
    SplitSettings,
    TransformSettings,
)
from evopem.config.strict_yaml import check_yaml_files
from evopem.errors import InputError


def completed(text):
    return complete(yaml.safe_load(text))


def dataset(text, name="a"):
    return completed(text).datasets[name]


def refusal(text):
    with pytest.raises(InputError) as caught:
        completed(text)
    sentence = str(caught.value)
    assert sentence.count("\n") == 0
    assert sentence.endswith(".")
    return sentence


def test_a_source_with_the_recipe_of_the_chapter_takes_the_built_in_values():
    assert completed(
        "datasets: {arm: {recipe: chapter, synthesis: flexible_arm}}"
    ) == Configuration(
        datasets={
            "arm": DatasetSettings(
                name="arm",
                keys={},
                source=SyntheticSource("flexible_arm", seed=1, samples=5000, sampling_rate=100.0),
                preparation=PreparationSettings(),
                spectrum=SpectrumSettings(),
                order_grid=OrderGrid(),
                search=SearchSettings(),
            )
        },
        run=RunSettings(one_job_per="stage"),
    )


def test_the_built_in_recipe_is_the_automatic_one():
    assert dataset("datasets: {a: {file: bench.csv}}").automatic == AutomaticSettings()
    for key in ("structure: arma", "structure: general"):
        assert dataset(f"datasets: {{a: {{file: bench.csv, {key}}}}}").automatic is not None
    assert dataset("datasets: {a: {file: bench.csv, recipe: chapter}}").automatic is None


def test_the_built_in_values_are_the_documented_ones():
    arm = dataset("datasets: {a: {recipe: chapter, synthesis: flexible_arm}}")
    assert arm.preparation.resample is None
    assert arm.preparation.transforms == TransformSettings(1.1, 2, 0)
    assert arm.preparation.split == SplitSettings(500, 0.8)
    assert arm.spectrum == SpectrumSettings(4.0, 8192)
    ranges = {"plant": (6, 14), "nc": (2, 16), "nb": (2, 16), "nd": (0, 4), "na": (0, 2)}
    assert arm.order_grid.ranges == OrderRanges(delay=(6, 9), nk=(0, 3), **ranges)
    search = arm.search
    assert (search.objective, search.refine) == ("absolute", "worst")
    assert (search.mu, search.lambda_, search.nu, search.seed) == (15, 100, 10, 1)
    assert (search.evaluations, search.max_root_radius) == (20000, 0.9999)
    assert search.n_initial_discard == 20
    assert completed("datasets: {a: {synthesis: armax}}").run == RunSettings(
        "auto", "stage", "html"
    )


def test_only_an_armax_recording_has_a_noise_ratio():
    assert dataset("datasets: {a: {synthesis: armax}}").source.noise == 0.1
    assert dataset("datasets: {a: {synthesis: armax, noise: 0}}").source.noise == 0
    assert dataset("datasets: {a: {synthesis: flexible_arm}}").source.noise is None


def test_a_file_needs_no_other_key():
    bench = dataset("datasets: {bench: {file: bench.csv}}", "bench")
    assert bench.source == RecordedSource(
        ("bench.csv",), ChannelSettings(), channels_from_file=True
    )


def test_own_keys_go_before_defaults_and_these_before_built_in_values():
    config = completed(
        """
        defaults: {recipe: chapter, search: {mu: 5, lambda: 50}, spectrum: {nfft: 1024}}
        datasets:
          one: {synthesis: armax, search: {mu: 7}}
          two: {synthesis: armax}
        """
    ).datasets
    assert (config["one"].search.mu, config["two"].search.mu) == (7, 5)
    assert config["one"].search.lambda_ == 50
    assert config["one"].search.nu == 10
    assert config["one"].spectrum == SpectrumSettings(4.0, 1024)


def test_the_order_of_keys_and_the_way_numbers_are_written_do_not_count():
    head = "datasets: {a: {recipe: chapter, "
    one = completed(head + "synthesis: armax, search: {mu: 7, seed: 3}, resample: 50}}")
    two = completed(head + "resample: 50.0, search: {seed: 3.0, mu: 7}, synthesis: armax}}")
    assert repr(one) == repr(two)


def test_an_independent_recording_leaves_all_samples_for_estimation():
    text = "datasets: {a: {file: a.csv, validation_file: b.csv}}"
    assert dataset(text).preparation.split.estimation == 1.0
    fraction = f"{{defaults: {{split: {{estimation: 0.5}}}}, {text}}}"
    assert dataset(fraction).preparation.split.estimation == 0.5


def test_all_samples_are_not_one_sample():
    text = "datasets: {a: {file: a.csv, validation_file: b.csv, split: {estimation: %s}}}"
    assert repr(dataset(text % "1.0").preparation.split.estimation) == "1.0"
    assert repr(dataset(text % "1").preparation.split.estimation) == "1"


def test_a_run_takes_the_keys_beside_the_data_sets():
    run = completed(
        """
        {datasets: {a: {synthesis: armax}, b: {synthesis: armax}}, candidates_per_job: 3,
         one_job_per: recording, report: none, shard: 2/2}
        """
    ).run
    assert run == RunSettings(3, "recording", "none", "2/2")


@pytest.mark.parametrize(
    ("count", "keys", "jobs"),
    [
        (9, "", "stage"),
        (10, "", "recording"),
        (10, ", shard: 1/5", "recording"),
        (10, ", one_job_per: stage", "stage"),
        (2, ", recordings_per_job: 2, report: none", "recording"),
    ],
)
def test_many_recordings_have_one_job_each(count, keys, jobs):
    names = ", ".join(f"r{n}: {{synthesis: armax}}" for n in range(count))
    assert completed(f"{{datasets: {{{names}}}{keys}}}").run.one_job_per == jobs


@pytest.mark.parametrize(
    # By estimate a recording takes 3.6 s: nine of them are half a minute, 84 five minutes.
    ("per_job", "count", "sizes"),
    [
        (1, 40, [1] * 40),
        (16, 40, [16, 16, 8]),
        ("auto", 40, [9] * 4 + [4]),
        ("auto", 160, [10] * 16),
        ("auto", 1600, [84] * 19 + [4]),
    ],
)
def test_recordings_are_divided_into_batches_before_shards(per_job, count, sizes):
    names = ", ".join(f"r{n}: {{synthesis: armax, samples: 900}}" for n in range(count))
    keys = f"recordings_per_job: {per_job}, one_job_per: recording, report: none"
    whole = completed(f"{{datasets: {{{names}}}, {keys}}}")
    assert [len(batch) for batch in whole.batches.values()] == sizes
    shard = completed(f"{{datasets: {{{names}}}, {keys}, shard: 2/3}}")
    assert shard.batches == {n: b for n, b in whole.batches.items() if int(n) % 3 == 2}
    assert [*shard.datasets] == [name for batch in shard.batches.values() for name in batch]


@pytest.mark.parametrize(
    ("keys", "remedy"),
    [
        ("one_job_per: stage, report: none", "write one_job_per: recording, or remove the key"),
        ("one_job_per: recording", "write report: none, or remove the key"),
    ],
)
def test_several_recordings_a_job_are_refused_where_there_is_no_such_job(keys, remedy):
    with pytest.raises(InputError, match=f"recordings_per_job: .*{remedy}"):
        completed(f"{{datasets: {{a: {{synthesis: armax}}}}, recordings_per_job: 2, {keys}}}")


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
        (FILE % "sampling_rate: 0", "datasets.arm.sampling_rate", "0 is below 1e-09"),
        (FILE % "input: 2", "datasets.arm.output", "2 is both input and output"),
        (FILE % "input: 0", "datasets.arm.input", "0 is below 1"),
        ("datasets: {arm: {file: 'x{1}.csv'}}", "datasets.arm.file", "the braces in x{1}.csv"),
        (FILE % "validation_file: x.csv", "datasets.arm.validation_file", "x.csv is also"),
        (
            "datasets: {arm: {synthesis: flexible_arm, noise: 1}}",
            "datasets.arm.noise",
            "an armax data set",
        ),
        (
            "datasets: {arm: {synthesis: armax, softening: 0.3}}",
            "datasets.arm.softening",
            "a flexible_arm data set",
        ),
        ("datasets: {arm: {synthesis: flexible_arm, softening: 1}}", "arm.softening", "below 1"),
        ("datasets: {arm: {synthesis: flexible}}", "arm.synthesis", "did you mean flexible_arm?"),
        (ARM % "samples: 5000.5", "datasets.arm.samples", "5000.5 cannot be used"),
        (ARM % "resample: 0", "datasets.arm.resample", "0 is below 1e-09"),
        (ARM % "resample: nine", "datasets.arm.resample", "nine is not known"),
        (ARM % "transforms: {box_cox: .nan}", "transforms.box_cox", "nan is not a finite"),
        (ARM % "transforms: {box_cox: aut}", "transforms.box_cox", "did you mean auto?"),
        (ARM % "transforms: {difference: 9}", "transforms.difference", "9 is above 4"),
        (ARM % "split: {estimation: 1.5}", "datasets.arm.split.estimation", "1.5 is above 1"),
        (ARM % "split: {estimation: 1.0}", "datasets.arm.split.estimation", "takes all samples"),
        (ARM % "split: {discard: -1}", "datasets.arm.split.discard", "-1 is below 0"),
        (ARM % "spectrum: {nfft: 8}", "datasets.arm.spectrum.nfft", "8 is below 16"),
        (ARM % "delay: {order: [6, 9]}", "datasets.arm.delay.order", "did you mean orders?"),
        (
            ARM % "recipe: chapter, delay: {orders: [9, 6]}",
            "datasets.arm.delay.orders",
            "write [6, 9]",
        ),
        (ARM % "delay: {orders: [6]}", "datasets.arm.delay.orders", "[6] holds 1 value"),
        (ARM % "delay: {orders: []}", "datasets.arm.delay.orders", "[] holds 0 values"),
        (ARM % "orders: {nb: [2, 99]}", "datasets.arm.orders.nb[1]", "99 is above 60"),
        (ARM % "delay: {orders: [6, x]}", "datasets.arm.delay.orders[1]", "x cannot be used"),
        (ARM % "orders: {plant: autoo}", "datasets.arm.orders.plant", "did you mean auto?"),
        (ARM % "orders: {nc: auto}", "datasets.arm.orders.nc", "auto cannot be used"),
        (ARM % "search: ", "datasets.arm.search", "there is no value"),
        (ARM % "search: {refine: wurst}", "datasets.arm.search.refine", "did you mean worst?"),
        (ARM % "search: {objective: abs}", "datasets.arm.search.objective", "abs is not known"),
        (
            ARM % "recipe: chapter, search: {nu: 200}",
            "datasets.arm.search.nu",
            "nu is 200 and lambda is 100",
        ),
        (
            ARM % "recipe: chapter, search: {lambda: 12}",
            "datasets.arm.search.lambda",
            "mu is 15 and lambda is 12",
        ),
        (ARM % "search: {seed: -1}", "datasets.arm.search.seed", "-1 is below 0"),
        (ARM % f"delay: {{nk: '{'9' * 500}'}}", "arm.delay.nk", "99... as text"),
        (f"{{datasets: {{a: {{file: x}}}}, shard: 1/{'9' * 5000}}}", "shard", "is not known"),
        (ARM % "search: {evaluations: 1e5}", "arm.search.evaluations", "YAML reads 1e5 as text"),
        (ARM % "search: {max_root_radius: 1}", "search.max_root_radius", "1 is not below 1"),
        ("{datasets: {a: {file: x}}, defaults: {file: x}}", "defaults.file", "no such key"),
        (
            "{datasets: {a: {file: x}}, defaults: {recipe: chapter, search: {lambda: 5}}}",
            "defaults.search.mu",
            "lambda is 5",
        ),
        ("{datasets: {a: {file: x}}, candidates_per_job: 0}", "candidates_per_job", "below 1"),
        ("{datasets: {a: {file: x}}, candidates_per_job: aut}", "per_job", "did you mean auto?"),
        ("{datasets: {a: {file: x}}, shard: 5/4}", "shard", "there is no shard 5/4"),
        ("datasets: [arm]", "datasets", "[arm] cannot be used"),
        ("datasets: absent.csv", "absent.csv", "No such file"),
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
        (
            "datasets: {checksums: {synthesis: armax}}",
            "datasets",
            "checksums is the name of",
        ),
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
