"""Plans and refusals: runs that do nothing yet."""

import copy as copies
import importlib
import re

import pytest
import yaml

from .conftest import ROOT, TINY

ARM = {"synthesis": "flexible_arm"}


@pytest.mark.parametrize(
    ("config", "fits", "total"),
    [
        ({"datasets": {"arm": ARM}}, 4, 18),
        ({"datasets": {"arm": ARM}, "candidates_per_job": 6}, 3 + 2 + 3 + 3, 25),
        ({"datasets": {"arm": ARM}, "candidates_per_job": 100}, 4, 18),
        (
            {
                "datasets": {"arm": {**ARM, "orders": {"common": "auto"}}},
                "candidates_per_job": 6,
            },
            3 + 3 + 3 + 3,
            26,
        ),
        ({"datasets": {"a": ARM, "b": ARM}}, 8, 37),
        ({"datasets": {"arm": ARM}, "report": "none"}, 4, 16),
    ],
)
def test_the_number_of_jobs_is_known_before_anything_runs(folder, config, fits, total):
    folder.configure(config)
    planned = folder.planned()
    assert planned["fit_candidates"] == fits
    assert sum(planned.values()) == total


def test_a_validation_file_is_read_as_well(folder):
    for name in ("a.csv", "b.csv"):
        (folder.path / name).write_text("1,2\n")
    folder.configure({"datasets": {"bench": {"file": "a.csv", "validation_file": "b.csv"}}})
    planned = folder.planned()
    assert planned["read_recording"] == 1
    assert planned["read_validation_recording"] == 1
    assert "synthesize_recording" not in planned


def test_auto_waits_for_the_spectrum_and_a_range_does_not(folder):
    for common, waits in (("auto", True), ([3, 4], False)):
        config = copies.deepcopy(TINY)
        config["defaults"]["orders"]["common"] = common
        folder.configure(config)
        planned = folder.planned("results/truth/phases/common.json")
        assert ("estimate_spectrum" in planned) == waits


def test_the_default_configuration_runs_from_the_checkout(folder):
    folder.finish("--directory", str(ROOT), "--quiet", "all", "--dry-run")


@pytest.mark.parametrize(
    ("text", "said"),
    [
        (
            "datasets: {arm: {synthesis: flexible_arm, sed: 1}}",
            "datasets.arm.sed: there is",
        ),
        ("datasets: {arm: {file: a, delay: {orders: [9, 6]}}}", "datasets.arm.delay.orders: the"),
        ("datasets: {arm: {file: a}}\ndatasets: {}", "config.yaml, line 2: the key datasets"),
        ("datasets: {arm: {file: a}", "config.yaml, line 1: this is not YAML"),
        ("datasets: {../arm: {file: a}}", "the data set name '../arm' cannot"),
        ("datasets: {Größe der Welle: {file: a}}", "'Größe der Welle' cannot be the name"),
        ("datasets: {arm: {file: a, orders: {b: []}}}", "datasets.arm.orders.b: [] holds 0"),
        ("datasets: {arm: {file: a, search: {seed: x}}}", "datasets.arm.search.seed: x cannot"),
        ("datasets: {arm: {synthesis: armax, file: a}}", "file and synthesis are both given"),
        ("defaults: {split: {estimation: 1.5}}\ndatasets: {arm: {file: a}}", "1.5 is neither"),
        ("", "config.yaml: there are no keys"),
    ],
)
def test_a_wrong_configuration_is_one_sentence_and_no_traceback(folder, text, said):
    (folder.path / "config.yaml").write_text(text)
    run = folder.run("--cores", "1")
    assert run.returncode != 0
    assert "Traceback" not in run.stdout
    (line,) = [line for line in run.stdout.splitlines() if said in line]
    assert line.startswith("config.yaml")
    assert not (folder.path / "results").exists()


def test_another_configuration_file_is_named_in_its_errors(folder):
    folder.configure({"datasets": {"arm": ARM}})
    (folder.path / "more.yaml").write_text("candidates_per_job: none\n")
    run = folder.run("--cores", "1", "--configfile", "more.yaml")
    assert run.returncode != 0
    assert "more.yaml, candidates_per_job: none is not known" in run.stdout


def test_bad_data_ends_in_one_sentence_and_leaves_other_data_sets_alone(folder):
    (folder.path / "bad.csv").write_text("1,2\n3,oops\n" * 300)
    bench = {"file": "bad.csv", "sampling_rate": 10}
    folder.configure(TINY | {"datasets": {"bench": bench, **TINY["datasets"]}})
    run = folder.run("--cores", "1", "--until", "prepare_signals")
    assert run.returncode != 0
    assert "Traceback" not in run.stdout
    assert "bad.csv" in (folder.results / "bench" / "logs" / "recording.log").read_text()
    assert not list((folder.results / "bench").glob("recording.*"))
    assert (folder.results / "truth" / "prepared.npz").exists()


@pytest.mark.parametrize("name", ["slurm", "generic"])
def test_a_clusters_profile_keeps_what_the_default_one_says(name):
    """`--workflow-profile` takes the place of profiles/default, its rerun triggers and all."""
    default, cluster = (
        yaml.safe_load((ROOT / "profiles" / each / "config.yaml").read_text())
        for each in ("default", name)
    )
    del default["cores"]  # a cluster's own are its jobs
    assert default.items() <= cluster.items()


def test_rules_and_package_agree_on_the_figures():
    figures = importlib.import_module("evopem.figures.registry").FIGURE_NAMES
    text = (ROOT / "workflow" / "rules" / "common.smk").read_text()
    listed = re.search(r"FIGURES = \((.*?)\)", text, re.DOTALL).group(1)
    assert tuple(re.findall(r'"(\w+)"', listed)) == figures


def test_built_in_settings_of_the_search_are_those_of_the_package():
    """One search, whether it is started from a configuration or from a notebook."""
    from evopem.config.defaults import complete
    from evopem.estimation.estimate import DEFAULT_BURN_IN, DEFAULT_MAX_ROOT_RADIUS
    from evopem.estimation.order_selection import search_settings
    from evopem.estimation.search.memetic import SearchSettings

    schema = ROOT / "workflow" / "schemas" / "config.schema.yaml"
    search = complete({"datasets": {"arm": ARM}}, schema)["datasets"]["arm"]["search"]
    assert search_settings(search) == SearchSettings()
    assert search["burn_in"] == DEFAULT_BURN_IN
    assert search["max_root_radius"] == DEFAULT_MAX_ROOT_RADIUS


def test_every_key_of_the_schema_is_documented():
    schema = yaml.safe_load((ROOT / "workflow" / "schemas" / "config.schema.yaml").read_text())
    text = (ROOT / "docs" / "configuration.md").read_text()

    def keys(node):
        for key, child in node.get("properties", {}).items():
            yield key
            yield from keys(child)

    nodes = [schema, *schema["$defs"].values()]
    missing = {key for node in nodes for key in keys(node) if f"`{key}`" not in text}
    assert missing == set()
