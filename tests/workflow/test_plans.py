"""Plans and refusals: runs that compute nothing."""

import copy as copies

import pytest
import yaml

from .conftest import ROOT, TINY

ARM = {"synthesis": "flexible_arm", "recipe": "chapter"}


@pytest.mark.parametrize(
    ("config", "estimations", "total"),
    [
        # Two jobs a phase, and 6 others.
        ({"datasets": {"arm": ARM}}, 4, 14),
        # 16, 9, 15 and 15 candidates in jobs of six; with `auto` 13 instead of 9. And two lists.
        (
            {
                "datasets": {"arm": ARM, "auto": {**ARM, "orders": {"plant": "auto"}}},
                "candidates_per_job": 6,
            },
            (3 + 2 + 3 + 3) + (3 + 3 + 3 + 3),
            (10 + 11) + (10 + 12) + 1,
        ),
        ({"datasets": {"arm": ARM}, "report": "none"}, 4, 13),
    ],
)
def test_the_number_of_jobs_is_known_before_anything_runs(folder, config, estimations, total):
    folder.configure(config)
    planned = folder.planned()
    assert planned["estimate_candidates"] == estimations
    assert sum(planned.values()) == total


def test_a_validation_file_is_read_as_well(folder):
    for name in ("a.csv", "b.csv"):
        (folder.path / name).write_text("1,2\n")
    folder.configure(
        {"datasets": {"bench": {"recipe": "chapter", "file": "a.csv", "validation_file": "b.csv"}}}
    )
    planned = folder.planned()
    assert planned["read_recording"] == 1
    assert "synthesize" not in planned


def test_set_ups_are_merged_when_all_of_them_are_whole(folder):
    config = copies.deepcopy(TINY)
    config["datasets"]["other"] = {"synthesis": "armax"}
    folder.configure(config | {"setups": {"beam": list(config["datasets"])}})
    planned = folder.planned("results/setups/beam.html")
    assert planned["merge_setups"] == 1
    assert planned["report"] == 2
    assert folder.planned()["merge_setups"] == 1


def test_auto_waits_for_the_spectrum_and_a_range_does_not(folder):
    config = copies.deepcopy(TINY)
    config["datasets"]["auto"] = {"synthesis": "armax", "orders": {"plant": "auto"}}
    folder.configure(config)
    target = "results/{}/phases/plant.json"
    planned = folder.planned(target.format("truth"), target.format("auto"))
    assert planned["select_candidate"] == 4
    assert planned["estimate_spectrum"] == 1


def test_the_default_configuration_runs_from_the_checkout(folder):
    folder.finish("--directory", str(ROOT), "--quiet", "all", "--dry-run")


# The sentences themselves are tested in tests/config.
@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("datasets: {arm: {synthesis: flexible_arm, sed: 1}}", "datasets.arm.sed: there is"),
        ("datasets: {arm: {file: a}}\ndatasets: {}", "config.yaml, line 2: the key datasets"),
        ("datasets: {Größe der Welle: {file: a}}", "'Größe der Welle' cannot be the name"),
        ("", "config.yaml: there are no keys"),
    ],
)
def test_a_wrong_configuration_is_one_sentence_and_no_traceback(folder, text, said):
    (folder.path / "config.yaml").write_text(text, encoding="utf-8")
    run = folder.run("--cores", "1")
    assert run.returncode != 0
    assert "Traceback" not in run.stdout
    (line,) = [line for line in run.stdout.splitlines() if said in line]
    assert line.startswith("config.yaml")
    assert not folder.results.exists()


def test_a_folder_without_a_configuration_or_with_a_dangling_link_is_said(folder):
    assert "write one by `evopem init`" in folder.run("--dry-run").stdout
    folder.configure({"datasets": {"arm": ARM}})
    folder.results.symlink_to("nowhere")
    assert "results: is no folder, and the results need" in folder.run("--dry-run").stdout
    folder.results.unlink()
    folder.configure({"datasets": {"arm": ARM}, "shard": f"1/{'9' * 5000}"})
    run = folder.run("--dry-run")
    assert "config.yaml, shard" in run.stdout
    assert "Traceback" not in run.stdout


def test_another_configuration_file_is_named_in_its_errors(folder):
    folder.configure({"datasets": {"arm": ARM}})
    (folder.path / "more.yaml").write_text("candidates_per_job: none\n")
    run = folder.run("--cores", "1", "--configfile", "more.yaml")
    assert run.returncode != 0
    assert "more.yaml, candidates_per_job: none is not known" in run.stdout


@pytest.mark.parametrize("name", ["slurm", "generic"])
def test_a_clusters_profile_keeps_what_the_default_one_says(name):
    """`--workflow-profile` replaces profiles/default, with its rerun triggers."""
    default, cluster = (
        yaml.safe_load((ROOT / "profiles" / each / "config.yaml").read_text())
        for each in ("default", name)
    )
    del default["cores"]  # a cluster counts jobs instead
    assert default.items() <= cluster.items()


def test_every_key_of_the_schema_is_documented():
    schema = yaml.safe_load((ROOT / "workflow" / "schemas" / "config.schema.yaml").read_text())
    text = (ROOT / "docs" / "configuration.md").read_text()

    def keys(node):
        for key, child in node.get("properties", {}).items():
            yield key
            yield from keys(child)

    nodes = [schema, *schema["$defs"].values()]
    # In the text, or in the example of a configuration.
    known = {key for node in nodes for key in keys(node) if f"`{key}`" in text or f"{key}:" in text}
    assert {key for node in nodes for key in keys(node)} == known
