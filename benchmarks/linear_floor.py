"""How often the stated limit of a model's part of the simulation error holds under random inputs.

    PYTHONPATH=workflow/scripts python benchmarks/linear_floor.py [--records 60]

White Gaussian input, of which the best linear approximation is known in closed form (Bussgang
1952): 1.21 and 1 + 0.03 var(x) times the linear part of the Hammerstein and the Wiener system.
Writes a section of docs/evidence/checks.md.
"""

import argparse

import numpy as np
from evidence import write_section
from nonlinear_distortion import A, B, hammerstein, linear, wiener
from scipy.signal import lfilter

from evopem.models.polynomial import PolynomialModel
from evopem.signals.recording import Recording
from evopem.validation.distortion import Distortion, floors_of
from evopem.validation.responses import divided

WARM_UP, HELD_OUT = 500, 0.7
EXCITED = np.random.default_rng(0).standard_normal(1_000_000)
GAINS = {linear: 1.0, wiener: 1.0 + 0.03 * np.var(linear(EXCITED)), hammerstein: 1.21}
MEANS = {system: np.mean(system(EXCITED)) for system in GAINS}


def judged(system, wrong, samples, noise, seed):
    """True part of the model in percent, the floor that is stated."""
    generator = np.random.default_rng(seed)
    u = generator.standard_normal(samples + WARM_UP)
    y = system(u) - MEANS[system]
    v = lfilter([1.0], [1.0, -0.8], generator.standard_normal(len(u)))
    y = y + noise * np.std(y) * v / np.std(v)
    model = PolynomialModel(A=[1.0], B=[wrong * GAINS[system] * B[1:]], F=[A], nk=[1])
    first = round((1.0 - HELD_OUT) * samples)
    stretches = divided(model, Recording(u[WARM_UP:], y[WARM_UP:], 1.0), first)
    (floor,) = floors_of(Distortion("The input does not repeat."), stretches, False)
    kept = slice(WARM_UP + first, None)
    part = abs(wrong - 1.0) * GAINS[system] * np.std(linear(u)[kept]) / np.std(y[kept])
    return 100.0 * part, floor


def main():
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--records", type=int, default=60)
    records, rows = parser.parse_args().records, []
    for system in GAINS:
        for noise in (0.02, 0.3):
            for wrong in (1.0, 1.2):
                for samples in (700, 3000):
                    found = [judged(system, wrong, samples, noise, k) for k in range(records)]
                    parts = np.array([part for part, _ in found])
                    limits = np.array([floor.rest.high for _, floor in found])
                    error = np.mean([floor.error_percent for _, floor in found])
                    reached = np.mean([floor.reached for _, floor in found])
                    rows.append(
                        [
                            *(system.__name__, f"{100 * noise:g}", samples, f"{error:.1f}"),
                            *(f"{np.mean(parts):.1f}", f"{np.mean(limits):.1f}"),
                            *(f"{100 * np.mean(parts <= limits):.1f}", f"{100 * reached:.1f}"),
                        ]
                    )
                    print(rows[-1], flush=True)
    write_section(
        "checks",
        "Floor of linear models",
        f"A random input, {records} records each, 70 % of the samples held out; a model of the best"
        " linear approximation, or 1.2 times it. The model's part of the simulation error, and the"
        " upper\nlimit that is stated of it, means in percent; shares of records, in percent, in"
        " which the limit holds, and in which the model is told to be at the floor.",
        "benchmarks/linear_floor.py",
        ("system", "noise", "samples", "error", "model", "limit", "holds", "at the floor"),
        rows,
    )


if __name__ == "__main__":
    main()
