"""Measure state-space estimates; docs/evidence/state_space.md holds the tables it prints.

    python benchmarks/state_space.py PART [--records 60] [--starts 30] [--recordings FOLDER]

Parts:

- recordings: simulation and one-step errors on validation samples that no choice has seen.
- optimum: the objective against local solutions of SciPy's least squares, all entries of A, B, C,
  K free, from independent starts.
- coverage: the share of 95 % intervals of frequencies, damping and shapes that cover the truth.
- large: the time for 28 outputs at order 20.
"""

from __future__ import annotations

import argparse
import sys
import time
from pathlib import Path

import numba
import numpy as np
from scipy.linalg import solve_discrete_are
from scipy.optimize import least_squares
from scipy.signal import lfilter
from threadpoolctl import threadpool_limits

ROOT = Path(__file__).resolve().parent.parent
sys.path.insert(0, str(ROOT / "workflow" / "scripts"))

from evopem.estimation.state_space.delays import estimate_delays  # noqa: E402
from evopem.estimation.state_space.estimate import (  # noqa: E402
    StateSpaceSettings,
    estimate_state_space,
    prediction_errors,
    simulation_errors,
    sweep_state_space_orders,
)
from evopem.models.state_space import StateSpaceModel  # noqa: E402

RATE = 100.0
# Inputs, outputs and modes of the truths.
TRUTHS = ((2, 2, 2), (1, 6, 3), (3, 3, 4), (2, 2, 6))


def truth(nu: int, ny: int, modes: int, form: str, seed: int = 0) -> StateSpaceModel:
    """A structure with complex shapes, whose noise comes from its states and its sensors."""
    generator = np.random.default_rng([seed, nu, ny, modes])
    n = 2 * modes
    A = np.zeros((n, n))
    for k in range(modes):
        angle = np.pi * (0.06 + 0.7 * (k + 0.6 * generator.random()) / modes)
        pole = np.exp((-0.02 - 0.02 * generator.random() + 1j) * angle)
        A[2 * k : 2 * k + 2, 2 * k : 2 * k + 2] = [[pole.real, pole.imag], [-pole.imag, pole.real]]
    B, C = generator.standard_normal((n, nu)), generator.standard_normal((ny, n))
    K = np.zeros((n, ny))
    if form == "innovations":
        P = solve_discrete_are(A.T, C.T, 0.05 * np.eye(n), np.eye(ny))
        K = A @ P @ C.T @ np.linalg.inv(C @ P @ C.T + np.eye(ny))
    return StateSpaceModel(
        A=A,
        B=B,
        C=C,
        D=np.zeros((ny, nu)),
        K=K,
        sampling_rate=RATE,
        level=np.zeros(ny),
        noise_covariance=np.eye(ny),
        form=form,
    )


def recorded(
    model: StateSpaceModel, samples: int, noise: float, seed: int, colour: float = 0.0
) -> tuple[np.ndarray, np.ndarray]:
    """White inputs, and outputs with innovations of a share of the output's deviation.

    ``colour`` is the pole of a first-order filter that the innovations of an output-error model
    go through.
    """
    generator = np.random.default_rng([seed, model.order, model.outputs, samples])
    u = generator.standard_normal((samples + 500, model.inputs))
    scale = noise * model.simulate(u).std(axis=0)
    e = scale * generator.standard_normal((samples + 500, model.outputs))
    e = lfilter([np.sqrt(1.0 - colour**2)], [1.0, -colour], e, axis=0)
    y = np.empty_like(e)
    x = np.zeros(model.order)
    for t in range(len(u)):
        y[t] = model.C @ x + e[t]
        x = model.A @ x + model.B @ u[t] + model.K @ e[t]
    return u[500:], y[500:]


@numba.njit
def _errors(A, B, C, K, level, x, u, y):  # type: ignore[no-untyped-def]
    e = np.empty_like(y)
    for t in range(len(y)):
        e[t] = y[t] - level - C @ x
        x = A @ x + B @ u[t] + K @ e[t]
    return e


def independent_optimum(u: np.ndarray, y: np.ndarray, start: StateSpaceModel, gain: bool) -> float:
    """Percent of the power that SciPy's least squares reaches from a start, entries free."""
    n, nu, ny = start.order, u.shape[1], y.shape[1]
    scale = y.std(axis=0)
    sizes = [n * n, n * nu, ny * n, n * ny * int(gain), ny]
    ends = np.cumsum(sizes)

    def residuals(p: np.ndarray) -> np.ndarray:
        A, B, C, K, level, x = np.split(p, ends)
        K = K.reshape(n, ny) if gain else np.zeros((n, ny))
        with np.errstate(all="ignore"):
            e = _errors(
                np.ascontiguousarray(A.reshape(n, n)),
                np.ascontiguousarray(B.reshape(n, nu)),
                np.ascontiguousarray(C.reshape(ny, n)),
                np.ascontiguousarray(K),
                level,
                x.copy(),
                u,
                y,
            )
        return np.clip(np.nan_to_num((e / scale).ravel(), nan=1e6), -1e6, 1e6)

    p0 = np.concatenate(
        [
            start.A.ravel(),
            start.B.ravel(),
            start.C.ravel(),
            start.K.ravel() if gain else np.empty(0),
            y.mean(axis=0),
            np.zeros(n),
        ]
    )
    found = least_squares(residuals, p0, xtol=1e-12, ftol=1e-12, gtol=1e-12, max_nfev=120)
    return 100.0 * 2.0 * found.cost / y.size


def optimum(starts: int) -> None:
    for nu, ny, modes in TRUTHS[:3]:
        for form in ("innovations", "output_error"):
            true = truth(nu, ny, modes, form)
            u, y = recorded(true, 300, 0.3, 1)
            begun = time.perf_counter()
            found = estimate_state_space(
                u, y, true.order, RATE, form=form, settings=StateSpaceSettings(weighting="power")
            )
            spent = time.perf_counter() - begun
            generator = np.random.default_rng(7)
            values = []
            for k in range(starts):
                spread = (0.02, 0.1, 0.3)[k % 3]
                start = true.with_parameters(
                    true.parameters
                    * (1.0 + spread * generator.standard_normal(true.parameters.size))
                )
                radius = np.abs(start.poles()).max()
                start = start.with_parameters(
                    np.concatenate(
                        [
                            (start.A * min(1.0, 0.98 / radius)).ravel(),
                            start.parameters[start.A.size :],
                        ]
                    )
                )
                values.append(independent_optimum(u, y, start, form == "innovations"))
            best = min(values)
            print(
                f"| {nu} × {ny} | {true.order} | {form} | {found.objective:.7f} | {best:.7f} | "
                f"{(found.objective - best) / best:+.1e} | "
                f"{sum(value < best * (1 + 1e-4) for value in values)} of {starts} | "
                f"{spent:.0f} s |",
                flush=True,
            )


def coverage(records: int) -> None:
    for nu, ny, modes in TRUTHS:
        for form, colour in (("innovations", 0.0), ("output_error", 0.0), ("output_error", 0.8)):
            true = truth(nu, ny, modes, form)
            true_modes = true.modes()
            hits: dict[str, list[bool]] = {"frequency": [], "damping": [], "shape": []}
            lost = 0
            for seed in range(records):
                u, y = recorded(true, 1000, 0.2, 100 + seed, colour)
                scores = sweep_state_space_orders(u, y, [true.order], RATE, form=form, folds=False)
                modes_found = scores.estimates[0].model.modes()
                for each in true_modes:
                    if not modes_found:
                        lost += 1
                        continue
                    found = min(modes_found, key=lambda m: abs(m.pole - each.pole))
                    if abs(found.pole - each.pole) > 0.1:
                        lost += 1
                        continue
                    hits["frequency"].append(
                        abs(found.frequency_hz - each.frequency_hz) < 1.96 * found.frequency_se_hz
                    )
                    hits["damping"].append(
                        abs(found.damping_ratio - each.damping_ratio) < 1.96 * found.damping_se
                    )
                    one = int(np.argmax(np.abs(found.shape)))
                    difference = found.shape - each.shape / each.shape[one]
                    for k in range(ny):
                        if k != one:
                            hits["shape"] += [
                                abs(difference[k].real) < 1.96 * found.shape_se_real[k],
                                abs(difference[k].imag) < 1.96 * found.shape_se_imag[k],
                            ]
            share = {name: 100.0 * np.mean(values) for name, values in hits.items()}
            noise = "coloured" if colour else "white"
            print(
                f"| {nu} × {ny} | {true.order} | {form} | {noise} | {records} | "
                f"{share['frequency']:.1f} % | "
                f"{share['damping']:.1f} % | {share['shape']:.1f} % | {lost} |",
                flush=True,
            )


def large() -> None:
    true = truth(2, 28, 10, "innovations")
    u, y = recorded(true, 8523, 0.1, 1)
    for form in ("output_error", "innovations"):
        begun = time.perf_counter()
        processor = time.process_time()
        found = estimate_state_space(u, y, 20, RATE, form=form, log=print)
        seconds = time.perf_counter() - begun
        processor = time.process_time() - processor
        frequencies = [mode.frequency_hz for mode in found.model.modes()]
        expected = [mode.frequency_hz for mode in true.modes()]
        matched = sum(min(abs(f - g) for g in frequencies) < 0.01 * f for f in expected)
        print(
            f"| {form} | {seconds:.0f} s | {processor:.0f} s | {found.objective:.5f} % | "
            f"{matched} of {len(expected)} |",
            flush=True,
        )


def recordings(folder: Path) -> None:
    arm = np.loadtxt(folder / "daisy" / "CD_player_arm.dat")
    evaporator = np.loadtxt(folder / "daisy" / "evaporator.csv", delimiter=",", skiprows=1)
    for name, data, nu, first, top in (
        ("CD player arm", arm, 2, 1500, 20),
        ("evaporator", evaporator, 3, 3300, 10),
    ):
        u, y = data[:first, :nu], data[:first, nu:]
        delays = estimate_delays(u, y)
        print(f"{name}: delays {delays}")
        later, measured = data[first:, :nu], data[first:, nu:]
        for form, weighting in (("output_error", "noise"), ("innovations", "noise")):
            scores = sweep_state_space_orders(
                u,
                y,
                range(1, top + 1),
                form=form,
                delays=delays,
                settings=StateSpaceSettings(weighting=weighting),
            )
            for by in ("bic", "simulation"):
                model = scores.best(by).model
                simulated = simulation_errors(model, later, measured)
                predicted = prediction_errors(model, later, measured)
                print(
                    f"| {name} | {form} | {by} | {model.order} | {simulated.mean():.2f} "
                    f"({', '.join(f'{s:.2f}' for s in simulated)}) | {predicted.mean():.2f} "
                    f"({', '.join(f'{s:.2f}' for s in predicted)}) |",
                    flush=True,
                )


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("part", choices=("recordings", "optimum", "coverage", "large"))
    parser.add_argument("--records", type=int, default=60)
    parser.add_argument("--starts", type=int, default=30)
    parser.add_argument("--recordings", type=Path, default=ROOT.parent / "shared" / "data")
    arguments = parser.parse_args()
    with threadpool_limits(limits=1, user_api="blas"):
        if arguments.part == "recordings":
            recordings(arguments.recordings)
        elif arguments.part == "optimum":
            optimum(arguments.starts)
        elif arguments.part == "coverage":
            coverage(arguments.records)
        else:
            large()


if __name__ == "__main__":
    main()
