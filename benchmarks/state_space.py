"""Measure state-space estimates; docs/evidence/state_space.md holds the tables it prints.

    python benchmarks/state_space.py PART [--records 60] [--starts 30] [--recordings FOLDER]

Parts:

- recordings: simulation and one-step errors on validation samples that no choice has seen.
- optimum: the objective against the best of descents of Marquardt's method, all entries of A, B, C,
  K, level and initial state free, from independent starts.  Only the descents with which a search
  begins: it cannot end above them.
- coverage: the share of 95 % intervals of frequencies, damping and shapes that cover the truth.
- large: the time for 28 outputs at order 20.
"""

from __future__ import annotations

import argparse
import sys
import time
from dataclasses import replace
from pathlib import Path

import numba
import numpy as np
from scipy.linalg import solve_discrete_are
from scipy.optimize import least_squares
from scipy.signal import lfilter
from threadpoolctl import threadpool_limits

ROOT = Path(__file__).resolve().parent.parent
sys.path.insert(0, str(ROOT / "workflow" / "scripts"))

from covered_intervals import CoveredIntervals  # noqa: E402

from evopem.config.settings import SearchSettings  # noqa: E402
from evopem.estimation.delays import estimate_delays  # noqa: E402
from evopem.estimation.state_space.estimate import estimate_state_space, estimates_of_orders  # noqa: E402
from evopem.models.state_space import StateSpaceModel  # noqa: E402
from evopem.signals.recording import Recording  # noqa: E402

RATE = 100.0
# Inputs, outputs and modes of the truths.
TRUTHS = ((2, 2, 2), (1, 6, 3), (3, 3, 4), (2, 2, 6))
# Those whose optimum is compared with independent starts.
OPTIMA = (
    *((2, 2, 2), (3, 3, 2), (1, 6, 2), (3, 3, 4)),
    *((1, 6, 4), (2, 2, 6), (3, 3, 6), (1, 6, 6)),
)
# Largest radius of poles, as in SearchSettings.
LARGEST_RADIUS = 0.9999
# Distance within which a pole of an estimate is that of a true mode.
SAME_POLE = 0.1
# Estimates that are descended from where coverage is counted.
COVERAGE_WIDTH = 2


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
    if form == "ss":
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
        structure=form,
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
def _sensitivities(A, B, C, K, level, x, u, y, gain):  # type: ignore[no-untyped-def]
    """One-step errors and their derivatives by all entries of A, B, C, K (with gain), level, x.

    Forward recursion ``dx+ = (A - K C) dx + dA x + dB u + dK e - K (dC x + dlevel)``.
    """
    n, nu, ny = len(A), B.shape[1], len(C)
    at_b = n * n
    at_c = at_b + n * nu
    at_k = at_c + ny * n
    at_level = at_k + (n * ny if gain else 0)
    at_x = at_level + ny
    count = at_x + n
    P = A - K @ C
    e, J = np.empty_like(y), np.empty((len(y), ny, count))
    d = np.zeros((n, count))
    for i in range(n):
        d[i, at_x + i] = 1.0
    for t in range(len(y)):
        e[t] = y[t] - level - C @ x
        now = -(C @ d)
        for j in range(ny):
            now[j, at_level + j] -= 1.0
            for i in range(n):
                now[j, at_c + j * n + i] -= x[i]
        J[t] = now
        d = P @ d
        for i in range(n):
            for j in range(n):
                d[i, i * n + j] += x[j]
            for j in range(nu):
                d[i, at_b + i * nu + j] += u[t, j]
            for j in range(ny):
                d[i, at_level + j] -= K[i, j]
                if gain:
                    d[i, at_k + i * ny + j] += e[t, j]
                for k in range(n):
                    d[i, at_c + j * n + k] -= K[i, j] * x[k]
        x = A @ x + B @ u[t] + K @ e[t]
    return e, J


class FreeEntries:
    """One-step errors, weighed by the outputs' power, over all entries; nothing of evopem's."""

    def __init__(self, u: np.ndarray, y: np.ndarray, order: int, gain: bool) -> None:
        self.u, self.y, self.order, self.gain = u, y, order, gain
        self.scale = y.std(axis=0)
        n, nu, ny = order, u.shape[1], y.shape[1]
        self.ends = np.cumsum([n * n, n * nu, ny * n, n * ny * int(gain), ny])

    def start(self, model: StateSpaceModel) -> np.ndarray:
        """Entries of a model with the means as level, at rest."""
        gain = model.K.ravel() if self.gain else np.empty(0)
        parts = (model.A.ravel(), model.B.ravel(), model.C.ravel(), gain)
        return np.concatenate([*parts, self.y.mean(axis=0), np.zeros(self.order)])

    def matrices(self, p: np.ndarray) -> tuple[np.ndarray, ...]:
        n, nu, ny = self.order, self.u.shape[1], self.y.shape[1]
        A, B, C, K, level, x = np.split(p, self.ends)
        K = K.reshape(n, ny) if self.gain else np.zeros((n, ny))
        return A.reshape(n, n), B.reshape(n, nu), C.reshape(ny, n), K, level, x.copy()

    def errors(self, p: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Errors, (N ny,), and their derivatives, (N ny, entries)."""
        with np.errstate(all="ignore"):
            e, J = _sensitivities(*self.matrices(p), self.u, self.y, self.gain)
        J = J / self.scale[:, None]
        return (e / self.scale).ravel(), J.reshape(e.size, -1)

    def allowed(self, p: np.ndarray) -> bool:
        """Whether model and predictor are as stable as evopem's have to be."""
        A, _, C, K, _, _ = self.matrices(p)
        return all(np.abs(np.linalg.eigvals(M)).max() <= LARGEST_RADIUS for M in (A, A - K @ C))

    def percent(self, squares: float) -> float:
        return 100.0 * squares / self.y.size


def marquardt(problem: FreeEntries, p: np.ndarray, steps: int = 300) -> tuple[np.ndarray, float]:
    """Where Marquardt's (1963) method ends, within the allowed, and the sum of squares there."""
    e, J = problem.errors(p)
    value, damping, small = float(e @ e), 1e-3, 0
    for _ in range(steps):
        hessian, gradient = J.T @ J, J.T @ e
        scales = np.sqrt(np.diag(hessian)) + 1e-12
        while damping < 1e12:
            damped = hessian + np.diag(damping * scales**2)
            trial = p - np.linalg.solve(damped, gradient)
            e, J = problem.errors(trial)
            squares = float(e @ e) if np.isfinite(e).all() else np.inf
            if squares < value and problem.allowed(trial):
                break
            damping *= 4.0
        else:
            return p, value
        small = small + 1 if value - squares < 1e-10 * value else 0
        p, value, damping = trial, squares, max(damping / 6.0, 1e-12)
        if small == 3:
            break
    return p, value


def independent_optima(
    u: np.ndarray, y: np.ndarray, true: StateSpaceModel, starts: int
) -> list[float]:
    """Percent of the power at the ends of descents from independent starts, all entries free.

    One in four starts from random poles and directions, the others from the truth with entries
    changed by 2, 10 or 30 %.  SciPy's least squares has the last word on the best one.
    """
    problem = FreeEntries(u, y, true.order, true.structure == "ss")
    ends = []
    for k in range(starts):
        generator = np.random.default_rng(np.random.SeedSequence(7, spawn_key=(k,)))
        spread = (None, 0.02, 0.1, 0.3)[k % 4]
        start = (
            random_model(true, generator) if spread is None else changed(true, spread, generator)
        )
        ends.append(marquardt(problem, problem.start(start)))
    best, value = min(ends, key=lambda end: end[1])
    polished = least_squares(
        lambda p: problem.errors(p)[0],
        best,
        jac=lambda p: problem.errors(p)[1],
        method="lm",
        xtol=1e-15,
        ftol=1e-15,
        gtol=1e-15,
        max_nfev=30,
    )
    if problem.allowed(polished.x) and 2.0 * polished.cost < value:
        ends.append((polished.x, 2.0 * polished.cost))
    return [problem.percent(squares) for _, squares in ends]


def changed(
    model: StateSpaceModel, spread: float, generator: np.random.Generator
) -> StateSpaceModel:
    """A model with all entries changed by a share of themselves, made stable."""
    entries = model.parameters * (1.0 + spread * generator.standard_normal(model.parameters.size))
    return stable(model.with_parameters(entries))


def random_model(model: StateSpaceModel, generator: np.random.Generator) -> StateSpaceModel:
    """A model of the same size with random poles and directions, K = 0."""
    n = model.order
    A = np.zeros((n, n))
    for k in range(n // 2):
        pole = generator.uniform(0.7, 0.98) * np.exp(1j * np.pi * generator.random())
        A[2 * k : 2 * k + 2, 2 * k : 2 * k + 2] = [[pole.real, pole.imag], [-pole.imag, pole.real]]
    return replace(
        model,
        A=A,
        B=generator.standard_normal(model.B.shape),
        C=generator.standard_normal(model.C.shape),
        K=np.zeros_like(model.K),
    )


def stable(model: StateSpaceModel) -> StateSpaceModel:
    """The model with poles drawn within 0.98 and those of its predictor within 0.99."""
    radius = np.abs(model.poles()).max()
    model = replace(model, A=model.A * min(1.0, 0.98 / radius))
    while np.abs(np.linalg.eigvals(model.predictor)).max() > 0.99:
        model = replace(model, K=0.8 * model.K)
    return model


def optimum(starts: int) -> None:
    for nu, ny, modes in OPTIMA:
        for form in ("ss", "ss_oe"):
            true = truth(nu, ny, modes, form)
            u, y = recorded(true, 300, 0.3, 1)
            begun = time.process_time()
            settings = SearchSettings(objective="quadratic", evaluations=0)
            found = estimate_state_space(
                Recording(u, y, RATE),
                true.order,
                structure=form,
                weighting="power",
                settings=settings,
            )
            spent = time.process_time() - begun
            begun = time.process_time()
            values = np.array(independent_optima(u, y, true, starts))
            peer = time.process_time() - begun
            best = values.min()
            near = int((values[:starts] < best * (1 + 1e-6)).sum())
            print(
                f"| {nu} × {ny} | {true.order} | {form} | {found.objective:.7f} | {best:.7f} | "
                f"{(found.objective - best) / best:+.1e} | {near} of {starts} | "
                f"{spent:.1f} s | {peer:.1f} s |",
                flush=True,
            )


def coverage(records: int) -> None:
    for nu, ny, modes in TRUTHS:
        for form, colour in (("ss", 0.0), ("ss_oe", 0.0), ("ss_oe", 0.8)):
            true = truth(nu, ny, modes, form)
            counted = CoveredIntervals()
            for seed in range(records):
                u, y = recorded(true, 1000, 0.2, 100 + seed, colour)
                (estimated,) = estimates_of_orders(
                    Recording(u, y, RATE), [true.order], structure=form, width=COVERAGE_WIDTH
                )
                modes_found = estimated.model.modes()
                counted.begin_record()
                for each in true.modes():
                    near = [m for m in modes_found if abs(m.pole - each.pole) <= SAME_POLE]
                    found = min(near, key=lambda m: abs(m.pole - each.pole), default=None)
                    counted.add(found, each.frequency_hz, each.damping_ratio, each.shape)
            noise = "coloured" if colour else "white"
            print(
                f"| {nu} × {ny} | {true.order} | {form} | {noise} | {records} | "
                f"{counted.cells()} |",
                flush=True,
            )


def large() -> None:
    true = truth(2, 28, 10, "ss")
    u, y = recorded(true, 8523, 0.1, 1)
    for form in ("ss_oe", "ss"):
        begun = time.perf_counter()
        processor = time.process_time()
        found = estimate_state_space(Recording(u, y, RATE), 20, structure=form, log=print)
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
        delays = estimate_delays(Recording(u, y, 1.0))
        print(f"{name}: delays {delays}")
        later, measured = data[first:, :nu], data[first:, nu:]
        for form, weighting in (("ss_oe", "noise"), ("ss", "noise")):
            asked = (Recording(u, y, 1.0), range(1, top + 1))
            options = {"structure": form, "delays": delays, "weighting": weighting}
            estimates = list(estimates_of_orders(*asked, **options))
            for by in ("bic", "coloured_bic"):
                model = min(estimates, key=lambda each, by=by: getattr(each, by)).model
                spread = np.linalg.norm(measured - measured.mean(axis=0), axis=0) / 100.0
                left = measured - model.simulate_from_fitted_state(later, measured)
                state = model.prediction_state(later, measured)
                e = model.residuals(later, measured, state)
                simulated, predicted = (np.linalg.norm(x, axis=0) / spread for x in (left, e))
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
