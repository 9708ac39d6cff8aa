"""Time and memory of planning many recordings, one job per recording or one per stage.

    python benchmarks/fleet_graph.py FOLDER [RECORDINGS ...]

plans fleets of empty recordings in FOLDER by dry runs and prints processor seconds and MB.
"""

import os
import subprocess
import sys
from pathlib import Path

import yaml

ROOT = Path(__file__).parents[1]


def plan(folder: Path, per: str) -> tuple[float, float, int]:
    """Processor seconds, largest memory in MB, and the number of jobs of one dry run."""
    config = {"datasets": "recordings.csv", "one_job_per": per, "report": "none"}
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
            (folder / "data" / f"{number}.csv").touch()
            rows.append(f"r{number},data/{number}.csv,100")
        (folder / "recordings.csv").write_text("\n".join(rows) + "\n")
        for per in ("recording", "stage"):
            seconds, memory, jobs = plan(folder, per)
            print(f"| {count} | {per} | {jobs} | {seconds:.1f} s | {memory:.0f} MB |", flush=True)


if __name__ == "__main__":
    main()
