"""Memory and time of every stage against the length of the record.

    python benchmarks/job_needs.py FOLDER [SAMPLES ...]

runs the workflow on a synthetic record of each length in FOLDER, with the largest orders of the
built-in ranges and two cores for the fits, and prints what Snakemake's benchmark files say. The
search is short: its length costs time alone.
"""

import csv
import subprocess
import sys
from pathlib import Path

import yaml

ROOT = Path(__file__).parents[1]
LENGTHS = (1_000, 10_000, 100_000, 1_000_000)


def configuration(samples: int) -> dict[str, object]:
    return {
        "candidates_per_job": "auto",
        "defaults": {
            "recipe": "chapter",
            "delay": {"orders": [14, 14], "nk": [1, 3]},
            "orders": {"plant": [12, 14], "nc": [14, 16], "nb": [14, 16]},
            "search": {"mu": 3, "lambda": 8, "nu": 8, "evaluations": 200},
        },
        "datasets": {"record": {"synthesis": "armax", "samples": samples}},
    }


def needs(folder: Path) -> dict[str, tuple[float, float]]:
    """Largest memory in MB and longest time in seconds of each stage's jobs."""
    found: dict[str, tuple[float, float]] = {}
    benchmarks = folder / "results" / "record" / "benchmarks"
    for file in sorted(benchmarks.rglob("*.tsv")):
        with file.open(encoding="utf-8") as stream:
            rows = list(csv.DictReader(stream, delimiter="\t"))
        stage = "fits" if file.parent.parent.name == "phases" else file.stem
        memory, seconds = found.get(stage, (0.0, 0.0))
        for row in rows:
            memory = max(memory, float(row["max_rss"]))
            seconds = max(seconds, float(row["s"]))
        found[stage] = (memory, seconds)
    return found


def main() -> None:
    base = Path(sys.argv[1])
    lengths = [int(argument) for argument in sys.argv[2:]] or LENGTHS
    table: dict[str, dict[int, tuple[float, float]]] = {}
    for samples in lengths:
        folder = base / str(samples)
        folder.mkdir(parents=True, exist_ok=True)
        (folder / "config.yaml").write_text(yaml.safe_dump(configuration(samples)))
        command = [sys.executable, "-m", "snakemake", "--snakefile", str(ROOT / "Snakefile")]
        subprocess.run([*command, "--cores", "2", "--quiet", "all"], cwd=folder, check=True)
        for stage, measured in needs(folder).items():
            table.setdefault(stage, {})[samples] = measured
    print("| stage |", " | ".join(f"{samples} samples" for samples in lengths), "|")
    print("|---|" + "---|" * len(lengths))
    for stage, row in table.items():
        cells = (f"{memory:.0f} MB, {seconds:.1f} s" for memory, seconds in row.values())
        print(f"| {stage} |", " | ".join(cells), "|")


if __name__ == "__main__":
    main()
