"""Time and memory of planning many recordings, several a job, one a job or one job per stage.

    python benchmarks/fleet_graph.py FOLDER [RECORDINGS ...]

plans fleets of recordings without contents in FOLDER by dry runs, and prints processor seconds and
MB.
"""

import os
import subprocess
import sys
from pathlib import Path

import yaml

ROOT = Path(__file__).parents[1]


DIVISIONS = {
    "up to five minutes": {"one_job_per": "recording", "recordings_per_job": "auto"},
    "recording": {"one_job_per": "recording"},
    "stage": {"one_job_per": "stage"},
}


def plan(folder: Path, per: str) -> tuple[float, float, int]:
    """Processor seconds, largest memory in MB, and the number of jobs of one dry run."""
    config = {"datasets": "recordings.csv", "report": "none", **DIVISIONS[per]}
    config["defaults"] = {"recipe": "chapter"}
    (folder / "config.yaml").write_text(yaml.safe_dump(config))
    command = [sys.executable, "-m", "snakemake", "--snakefile", str(ROOT / "Snakefile")]
    with (folder / "plan.txt").open("w") as output:
        run = subprocess.Popen(
            [*command, "--dry-run", "--quiet", "rules"], cwd=folder, stdout=output, stderr=output
        )
        _, status, used = os.wait4(run.pid, 0)
    text = (folder / "plan.txt").read_text()
    assert status == 0, text
    total = next(line for line in text.splitlines() if line.startswith("total"))
    return used.ru_utime + used.ru_stime, used.ru_maxrss / 1024, int(total.split()[1])


def main() -> None:
    base = Path(sys.argv[1])
    print("| recordings | one job per | jobs | processor time | memory |")
    print("|---|---|---|---|---|")
    for count in [int(argument) for argument in sys.argv[2:]] or [10, 100, 1_000, 10_000]:
        folder = base / str(count)
        (folder / "data").mkdir(parents=True, exist_ok=True)
        rows = ["name,file,sampling_rate"]
        for number in range(count):
            # As long as 2000 samples of text, which decides how many recordings a job takes.
            with (folder / "data" / f"{number}.csv").open("wb") as file:
                file.truncate(100_000)
            rows.append(f"r{number},data/{number}.csv,100")
        (folder / "recordings.csv").write_text("\n".join(rows) + "\n")
        for per in DIVISIONS if count < 10_000 else list(DIVISIONS)[:2]:
            seconds, memory, jobs = plan(folder, per)
            print(f"| {count} | {per} | {jobs} | {seconds:.1f} s | {memory:.0f} MB |", flush=True)


if __name__ == "__main__":
    main()
