"""Memory and time of each step on a recording of very many samples.

    python benchmarks/long_recording.py [samples] [last rule]

Runs the workflow on a recording of 10^7 samples (an .npz file of 160 MB), from reading to the fit
of one model of small order, and prints what Snakemake measured of each job.
"""

import csv
import subprocess
import sys
import tempfile
from pathlib import Path

import numpy as np
import yaml
from scipy.signal import lfilter

ROOT = Path(__file__).resolve().parent.parent
CONFIG = {
    "defaults": {
        "recipe": "chapter",
        "transforms": {"box_cox": "none", "difference": 0},
        "delay": {"orders": [2, 2], "nk": [1, 1]},
        "orders": {"plant": [2, 2], "nc": [2, 2], "nb": [2, 2]},
        "search": {"mu": 2, "lambda": 4, "nu": 2, "evaluations": 100},
    },
    "datasets": {"long": {"file": "long.npz", "input": "u", "output": "y", "sampling_rate": 1000}},
}


def main(samples: int = 10_000_000, last: str = "results/long/phases/delay.json") -> None:
    with tempfile.TemporaryDirectory() as folder:
        generator = np.random.default_rng(1)
        u, e = generator.standard_normal((2, samples))
        y = lfilter([0.0, 1.0, 0.5], [1.0, -1.5, 0.7], u) + 0.1 * e
        np.savez(Path(folder) / "long.npz", u=u, y=y)
        (Path(folder) / "config.yaml").write_text(yaml.safe_dump(CONFIG))
        del u, e, y
        command = [sys.executable, "-m", "snakemake", "--snakefile", str(ROOT / "Snakefile")]
        targets = [] if last == "all" else ["results/long/spectrum.json", last]
        run = subprocess.run([*command, "--quiet", "all", "--cores", "1", *targets], cwd=folder)
        print("| step | wall s | processor s | peak MB |\n|---|---|---|---|")
        times = Path(folder) / "results" / "long" / "benchmarks"
        for file in sorted(times.rglob("*.tsv"), key=lambda file: file.stat().st_mtime):
            with file.open() as stream:
                (row,) = csv.DictReader(stream, delimiter="\t")
            name = file.relative_to(times).with_suffix("")
            print(f"| {name} | {row['s']} | {row['cpu_time']} | {row['max_rss']} |")
        sys.exit(run.returncode)


if __name__ == "__main__":
    main(*(kind(value) for kind, value in zip((int, str), sys.argv[1:], strict=False)))
