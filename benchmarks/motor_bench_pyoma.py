"""What pyOMA2 finds in the motor bench's recordings: `python benchmarks/motor_bench_pyoma.py`.

It needs `pip install pyOMA-2==1.4.3 matplotlib`. The numbers and the picture stand in
docs/evidence/side_by_side.md.
"""

import sys
from pathlib import Path

import numpy as np
from matplotlib import pyplot
from pyoma2.algorithms import FSDD, SSI
from pyoma2.setup import SingleSetup

ROOT = Path(__file__).parents[1]
RESONANCE = 76.0  # Hz, read off the stabilisation diagram
ORDER = 8
DECIMATION = 5  # 2500 Hz to 500 Hz


def signals(recording: str) -> tuple[np.ndarray, np.ndarray]:
    """Input and both velocities at 2500 Hz, without their means."""
    file = ROOT / "examples" / "motor_bench" / f"multisine_{recording}.csv"
    columns = np.genfromtxt(file, delimiter=",", skip_header=1)[:, 1:]
    columns -= columns.mean(axis=0)
    return columns[:, :1], columns[:, 1:]


def main(picture: Path | None) -> None:
    for recording in "ab":
        u, y = signals(recording)
        setup = SingleSetup(np.column_stack([u, y]), fs=2500.0)
        setup.decimate_data(q=DECIMATION)
        data, rate = setup.data, setup.fs
        setup = SingleSetup(data[:, 1:], fs=rate)
        # br, ordmax: blocks and orders as in its examples; standard errors from 20 parts.
        output_only = SSI(name="cov", method="cov", br=25, ordmax=30, calc_unc=True, nb=20)
        with_input = SSI(name="IOcov", method="IOcov", br=25, ordmax=30, U=data[:, :1])
        frequency = FSDD(name="FSDD", nxseg=512)
        setup.add_algorithms(output_only, with_input, frequency)
        for algorithm in (output_only, with_input, frequency):
            setup.run_by_name(algorithm.name)
            if algorithm is frequency:
                setup.mpe("FSDD", sel_freq=[RESONANCE], DF1=2.0, DF2=10.0, sppk=1, npmax=10)
            else:
                setup.mpe(algorithm.name, sel_freq=[RESONANCE], order_in="find_min")
                if algorithm.result.order_out is None:  # in no order was it stable throughout
                    setup.mpe(algorithm.name, sel_freq=[RESONANCE], order_in=ORDER)
            found = algorithm.result
            spread = getattr(found, "Fn_std", None), getattr(found, "Xi_std", None)
            print(
                f"{recording} {algorithm.name}: {np.ravel(found.Fn)} Hz,"
                f" {100 * np.ravel(found.Xi)} %, standard errors {spread},"
                f" order {getattr(found, 'order_out', None)}"
            )
        if recording == "a" and picture is not None:
            figure, _ = output_only.plot_stab(freqlim=(0, 250), hide_poles=False)
            figure.set_size_inches(7, 3.4)
            figure.savefig(picture, dpi=80, bbox_inches="tight")
            pyplot.close(figure)


if __name__ == "__main__":
    main(Path(sys.argv[1]) if len(sys.argv) > 1 else None)
