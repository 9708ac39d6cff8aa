"""How far results move between kinds of processor, imitated on this one.

    python benchmarks/processor_kinds.py

OpenBLAS, numpy and numba choose their machine code by the processor. Each can be told to take an
older one, so that the same search runs with other roundings; what moves in its result is printed.
The workflow has OpenBLAS take its code for AVX2 wherever there is that.
"""

import json
import os
import subprocess
import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parent.parent / "workflow" / "scripts"))

from evopem.config.configuration import blas_code

NO_AVX512 = "AVX512F AVX512CD AVX512_SKX AVX512_CLX AVX512_CNL AVX512_ICL AVX512_SPR"
HASWELL = {"NUMBA_CPU_NAME": "haswell", "NUMBA_CPU_FEATURES": ""}
KINDS = {
    "as the workflow runs it": {},
    "numpy without AVX-512": {"NPY_DISABLE_CPU_FEATURES": NO_AVX512},
    "numba for Haswell (AVX2)": HASWELL,
    "both": {"NPY_DISABLE_CPU_FEATURES": NO_AVX512, **HASWELL},
    "OpenBLAS for SkylakeX (AVX-512)": {"OPENBLAS_CORETYPE": "SkylakeX"},
    "OpenBLAS for Prescott (SSE3)": {"OPENBLAS_CORETYPE": "Prescott"},
}
ORDERS = ((4, 4, 4, 3), (7, 6, 7, 3), (10, 10, 10, 3))
RECORDS = (1, 2)
MODES = (5.36, 16.65, 37.0)  # Hz: those of the records; others come and go with the orders


def search() -> list[dict]:
    """Objective, BIC and modes of a few orders on known records, with the built-in settings."""
    from evopem import estimate
    from evopem.synthesis import armax

    found = []
    for seed in RECORDS:
        record, _ = armax(seed, samples=3000)
        for orders in ORDERS:
            fit = estimate(record.input, record.output, orders, 100.0)
            modes = [
                min(
                    ((mode.frequency_hz, mode.damping_ratio) for mode in fit.model.modes()),
                    key=lambda mode: abs(mode[0] - true),
                )
                for true in MODES
            ]
            found.append(
                {"objective": fit.criteria.objective, "bic": fit.criteria.bic, "modes": modes}
                | {"orders": orders, "bits": [float(x).hex() for x in fit.model.A]}
            )
    return found


def main() -> None:
    results = {}
    for kind, environment in KINDS.items():
        run = subprocess.run(
            [sys.executable, __file__, "--search"],
            env=os.environ | blas_code() | environment,
            capture_output=True,
            text=True,
            check=False,
        )
        if run.returncode:
            print(f"{kind}: not possible here ({run.stderr.strip().splitlines()[-1]})")
            continue
        results[kind] = json.loads(run.stdout)
    base = results["as the workflow runs it"]
    print(f"Largest relative differences over {len(base)} searches, {len(RECORDS)} records:")
    print("| kind | same bits | objective | BIC | frequency | damping |")
    print("|---|---|---|---|---|---|")
    for kind, found in results.items():
        same = sum(one["bits"] == other["bits"] for one, other in zip(base, found, strict=True))
        moved = [f"{same} of {len(base)}"]
        for values in (
            lambda fit: [fit["objective"]],
            lambda fit: [fit["bic"]],
            lambda fit: [frequency for frequency, _ in fit["modes"]],
            lambda fit: [damping for _, damping in fit["modes"]],
        ):
            pairs = [
                (one, other)
                for fits in zip(base, found, strict=True)
                for one, other in zip(*map(values, fits), strict=True)
            ]
            moved.append(f"{max(abs(other / one - 1.0) for one, other in pairs):.1e}")
        print(f"| {kind} | {' | '.join(moved)} |")


if __name__ == "__main__":
    if "--search" in sys.argv:
        print(json.dumps(search()))
    else:
        main()
