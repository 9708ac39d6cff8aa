"""What a run shows: a line for each job, and what came out, instead of lists of files."""

import re
import zipfile
from pathlib import Path


def test_a_run_ends_with_its_results(copy):
    printed = copy.finish("--forcerun", "report", drawn=False)
    assert "report truth" in printed
    assert "input: results/" not in printed
    before, _, end = printed.partition("steps (100%) done\n")
    assert re.search(r"steps \(\d+%\) done, about \d+ s left\n", before)
    assert end.lstrip().startswith("truth: ")
    assert "errors  one step ahead" in end
    assert "report  results/truth/report.html" in end
    # Every detail is in the log file of the run, and on the terminal where it is asked for.
    (log,) = sorted((copy.path / ".snakemake" / "log").glob("*"))[-1:]
    assert "input: results/truth/truth.json" in log.read_text()
    one = ("--forcerun", "estimate_spectrum", "--until", "estimate_spectrum")
    assert "input: results/" in copy.finish(*one, "--verbose")


def test_a_dry_run_is_that_of_snakemake(copy):
    printed = copy.finish("--dry-run", "--forcerun", "report")
    assert "input: results/truth/truth.json" in printed
    assert "errors  one step ahead" not in printed


def test_a_failed_run_says_what_came_of_each_data_set(copy):
    Path(copy.files_of("truth").report).unlink()
    (copy.path / "empty.csv").touch()
    config = (copy.path / "config.yaml").read_text()
    (copy.path / "config.yaml").write_text(f"{config}  bad: {{file: empty.csv}}\n")
    run = copy.run("--cores", "2", drawn=False)
    assert run.returncode != 0
    end = run.stdout.rpartition("steps (")[2]
    assert "report  results/truth/report.html" in end
    assert "bad: failed. empty.csv: the file is empty; export or copy it again.\n" in end
    assert "All data sets: results/index.html" in end
    # Snakemake's own report has the others, and says which one it leaves out.
    printed = copy.finish("--report", "report.zip")
    assert "bad is left out of the report: empty.csv: the file is empty" in printed
    with zipfile.ZipFile(copy.path / "report.zip") as packed:
        assert any(name.endswith("/report.html") for name in packed.namelist())
