"""How well do automatically chosen models simulate?  Random systems, compared without noise.

    python benchmarks/chosen_simulation.py [--first 0] [--records 40]

Systems of order 1 to 6 with delays of 0 to 5 samples; 400 to 1,500 samples of a white, binary or
coloured input; 5 to 50 % of white, equation-error, coloured or drifting noise.  The chosen model is
simulated on through half as many fresh samples, with the state and the level that the recording
gives, and compared with their noise-free output up to a constant.  Run it in two checkouts to
compare rules.
"""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

import numpy as np
from scipy.signal import lfilter
from threadpoolctl import threadpool_limits

sys.path.insert(0, str(Path(__file__).resolve().parent.parent / "workflow" / "scripts"))

from evopem.automatic.identify import Identification, identify
from evopem.automatic.preparation import prepare
from evopem.signals.recording import Recording

Array = np.ndarray
SETTLING = 500


def random_poles(generator: np.random.Generator) -> Array:
    """Pairs of damping ratio 0.005 to 0.3, and real poles of 0.2 to 0.98."""
    order, poles = int(generator.integers(1, 7)), []
    while len(poles) < order:
        if order - len(poles) >= 2 and generator.random() < 0.7:
            frequency = generator.uniform(0.05, 2.5)
            damping = np.exp(generator.uniform(np.log(0.005), np.log(0.3)))
            pole = np.exp(-damping * frequency + 1j * frequency)
            poles += [pole, pole.conjugate()]
        else:
            poles.append(complex(generator.uniform(0.2, 0.98)))
    return np.array(poles)


def recording(seed: int) -> tuple[Array, Array, Array, int]:
    """Input, measured and noise-free output, and the number of samples for estimation."""
    generator = np.random.default_rng(seed)
    samples, delay = int(generator.choice([400, 800, 1500])), int(generator.integers(0, 6))
    a = np.real(np.poly(random_poles(generator)))
    b = generator.standard_normal(int(generator.integers(1, len(a))))
    b[0] = np.sign(b[0]) * max(abs(b[0]), 0.3 * np.abs(b).max())
    total = samples + samples // 2 + SETTLING
    white, held = generator.standard_normal((2, total))
    inputs = (white, np.repeat(np.sign(held), 4)[:total], lfilter([1], [1, -0.8], white))
    u = inputs[int(generator.integers(3))]
    x = lfilter(np.concatenate([np.zeros(delay), b]), a, u)
    e = generator.standard_normal(total)
    noises = (
        e,
        lfilter([1], a, e),
        lfilter([1, 0.5], [1, -0.9], e),
        0.3 * lfilter([1], [1, -0.999], e) + 0.3 * e,
    )
    u, x, v = (each[SETTLING:] for each in (u, x, noises[int(generator.integers(4))]))
    y = x + float(generator.choice([0.05, 0.2, 0.5])) * x.std() / v.std() * v
    return u, y, x, samples


def noise_free_error(found: Identification, u: Array, y: Array, x: Array, samples: int) -> float:
    """Error of the simulation of fresh samples in percent of their noise-free deviation."""
    plan, model = found.prepared.plan, found.choice.candidate.model
    (measured,), (clean,) = (
        prepare(each, plan.for_others(each)).stretches
        for each in (Recording(u, output, 1.0) for output in (y, x))
    )
    known = round(samples * measured.samples / len(u))
    a = model.plant_denominator
    impulse = np.zeros(measured.samples)
    impulse[0] = 1.0
    decay = lfilter([1.0], a, impulse)
    free = [np.concatenate([np.zeros(k), decay[: len(decay) - k]]) for k in range(len(a) - 1)]
    columns = np.column_stack([*free, np.ones(measured.samples)])
    response = lfilter(model.delayed_b, a, measured.input)
    state = np.linalg.lstsq(columns[:known], (measured.output - response)[:known], rcond=1e-10)[0]
    truth = clean.output[known:]
    return float(100.0 * np.std(truth - (response + columns @ state)[known:]) / np.std(truth))


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--first", type=int, default=0, help="seed of the first recording")
    parser.add_argument("--records", type=int, default=40)
    arguments = parser.parse_args()
    print("| recording | model | parameters | error, % |\n|---|---|---|---|")
    errors, sizes = [], []
    with threadpool_limits(limits=1, user_api="blas"):
        for seed in range(arguments.first, arguments.first + arguments.records):
            u, y, x, samples = recording(seed)
            found = identify(u[:samples], y[:samples], 1.0)
            candidate = found.choice.candidate
            errors.append(noise_free_error(found, u, y, x, samples))
            sizes.append(candidate.parameters)
            row = f"{seed} | {candidate.name} | {sizes[-1]} | {errors[-1]:.3g}"
            print(f"| {row} |", flush=True)
    mean = float(np.exp(np.mean(np.log(errors))))
    print(f"| geometric mean | | {np.exp(np.mean(np.log(sizes))):.3g} | {mean:.3g} |")


if __name__ == "__main__":
    main()
