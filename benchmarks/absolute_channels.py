"""The absolute objective of several channels; writes its sections of docs/evidence/outliers.md.

    python benchmarks/absolute_channels.py errors [--records 10]
    python benchmarks/absolute_channels.py optimum [--records 12]
    python benchmarks/absolute_channels.py coverage [--records 100]

``errors``: both objectives on records of which a share of the output samples are outliers.
``optimum``: the optimum against the best of independent starts by successive linear programmes in
a trust region (Osborne & Watson 1971) over all entries of A, B, C, K, level and initial state.
``coverage``: how often 95 % intervals contain the true value.
"""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

import numpy as np
from evidence import write_section
from scipy.optimize import linprog
from scipy.signal import lfilter
from scipy.sparse import csr_array, eye_array, hstack, vstack
from state_space import RATE, FreeEntries, changed, random_model, recorded, truth

ROOT = Path(__file__).resolve().parent.parent
sys.path.insert(0, str(ROOT / "workflow" / "scripts"))

from evopem.config.settings import SearchSettings  # noqa: E402
from evopem.estimation.state_space.estimate import estimate_state_space  # noqa: E402
from evopem.models.state_space import StateSpaceModel  # noqa: E402
from evopem.signals.recording import Recording  # noqa: E402

OBJECTIVES = ("absolute", "quadratic")
SHAPES, COVERED = ((2, 2, 2), (1, 6, 3)), ((2, 2, 2),)
FORMS = ("ss_oe", "ss")
NAMES = {"ss_oe": "output error", "ss": "innovations"}
SHARES = (0.0, 0.01, 0.03, 0.1)
SAMPLES, NOISE, SIZE = 1000, 0.1, 10.0
SMALL = ((2, 2, 2), (3, 3, 2))
COLOUR = 0.8


def spiked(y: np.ndarray, share: float, seed: int) -> np.ndarray:
    """The outputs with outliers of ten of their standard deviations, of either sign."""
    generator = np.random.default_rng([seed, y.shape[1], round(1000 * share)])
    hits = generator.random(y.shape) < share
    return y + hits * SIZE * y.std(axis=0) * generator.choice([-1.0, 1.0], y.shape)


def estimated(u: np.ndarray, y: np.ndarray, true: StateSpaceModel, objective: str):
    settings = SearchSettings(objective=objective, evaluations=0)
    return estimate_state_space(
        Recording(u, y, RATE),
        true.order,
        structure=true.structure,
        weighting="noise",
        settings=settings,
    )


def nearest(model: StateSpaceModel, mode):
    return min(model.modes(), key=lambda each: abs(each.frequency_hz - mode.frequency_hz))


def errors(records: int) -> None:
    rows = []
    for nu, ny, modes in SHAPES:
        for form in FORMS:
            true = truth(nu, ny, modes, form)
            cells = []
            for share in SHARES:
                each = np.array([_errors_of(true, share, seed) for seed in range(records)])
                medians = np.median(each, axis=0)
                print(nu, ny, form, share, medians, flush=True)
                cells.append("/".join(f"{simulation:.2g}" for simulation in medians[:, 0]))
            rows.append([f"{nu}×{ny}", NAMES[form], *cells])
    write_section(
        "outliers",
        "State-space models",
        f"The same for {records} records of {SAMPLES} samples, true orders, noise of "
        f"{100 * NOISE:.0f} %, outliers of ten standard deviations of each output on the measured\n"
        "samples. In innovations form outliers enter the predictor and disturb later errors, too.",
        "benchmarks/absolute_channels.py errors",
        ("channels", "form", *(f"{100 * share:.0f} %" for share in SHARES)),
        rows,
    )


def _errors_of(true: StateSpaceModel, share: float, seed: int) -> list[list[float]]:
    u, y = recorded(true, SAMPLES, NOISE, seed)
    clean = true.simulate(u)
    rows = []
    for objective in OBJECTIVES:
        model = estimated(u, spiked(y, share, seed), true, objective).model
        deviation = (model.simulate(u) - model.level - clean)[200:]
        relative = np.linalg.norm(deviation, axis=0) / np.linalg.norm(clean[200:], axis=0)
        pairs = [(nearest(model, mode), mode) for mode in true.modes()]
        rows.append(
            [
                100.0 * float(relative.mean()),
                100.0 * max(abs(m.frequency_hz / t.frequency_hz - 1.0) for m, t in pairs),
                100.0 * max(abs(m.damping_ratio / t.damping_ratio - 1.0) for m, t in pairs),
            ]
        )
    return rows


def optimum(starts: int) -> None:
    rows = []
    for nu, ny, modes in SMALL:
        for form in FORMS:
            true = truth(nu, ny, modes, form)
            u, y = recorded(true, 200, 0.3, 1)
            y = spiked(y, 0.03, 1)
            found = estimate_state_space(
                Recording(u, y, RATE),
                true.order,
                structure=form,
                weighting="noise",
                settings=SearchSettings(objective="absolute", evaluations=2000),
            )
            problem = FreeEntries(u, y, true.order, form == "ss")
            ends = [descended(problem, each) for each in _starts(problem, true, starts)]
            best = min(ends)
            point = problem.start(found.model)
            point[problem.ends[-2] :] = np.concatenate(
                [found.segment_levels[0], found.initial_states[0]]
            )
            value = percent(problem, problem.errors(point)[0])
            continued = descended(problem, point)
            near = sum(end < best * (1.0 + 1e-6) for end in ends)
            differences = [f"{value / each - 1.0:+.1e}" for each in (best, continued)]
            rows.append([f"{nu}×{ny}", NAMES[form], *differences, f"{near}/{starts}"])
            print(rows[-1], flush=True)
    write_section(
        "outliers",
        "Optimum of state-space models",
        f"200 samples, 3 % outliers. The reference: the best of {starts} descents by successive "
        "linear programmes over all entries of the matrices, from\nrandom poles or the changed "
        "truth. Differences of the objective, relative; *continued*: to the reference's descent "
        "from evopem's optimum.",
        "benchmarks/absolute_channels.py optimum",
        ("channels", "form", "to the reference", "continued", "within 10⁻⁶"),
        rows,
    )


def percent(problem: FreeEntries, e: np.ndarray) -> float:
    """Geometric mean over the outputs of the mean absolute errors, percent of the outputs'."""
    ny = problem.y.shape[1]
    if not np.isfinite(e).all():
        return np.inf
    sizes = np.mean(np.abs(problem.y - problem.y.mean(axis=0)), axis=0) / problem.scale
    return 100.0 * float(
        np.exp(np.mean(np.log(np.mean(np.abs(e.reshape(-1, ny)), axis=0) / sizes)))
    )


def _starts(problem: FreeEntries, true: StateSpaceModel, count: int):
    for k in range(count):
        generator = np.random.default_rng(np.random.SeedSequence(7, spawn_key=(k,)))
        spread = (None, 0.02, 0.1, 0.3)[k % 4]
        model = (
            random_model(true, generator) if spread is None else changed(true, spread, generator)
        )
        yield problem.start(model)


def descended(problem: FreeEntries, p: np.ndarray, steps: int = 60) -> float:
    """Percent at the end of a descent by linear programmes."""
    ny = problem.y.shape[1]
    radius = 0.3
    e, J = problem.errors(p)
    value = percent(problem, e)
    for _ in range(steps):
        weights = np.tile(1.0 / np.sum(np.abs(e.reshape(-1, ny)), axis=0), len(e) // ny)
        trial = p + _linear_step(e * weights, J * weights[:, None], radius)
        new_e, new_J = problem.errors(trial)
        new = percent(problem, new_e)
        if new < value and problem.allowed(trial):
            gain, radius = 1.0 - new / value, 2.0 * radius
            p, e, J, value = trial, new_e, new_J, new
            if gain < 1e-11:
                break
        else:
            radius *= 0.25
            if radius < 1e-9:
                break
    return value


def _linear_step(e: np.ndarray, J: np.ndarray, radius: float) -> np.ndarray:
    rows, count = J.shape
    sparse, one = csr_array(J), eye_array(rows)
    found = linprog(
        np.concatenate([np.zeros(count), np.ones(rows)]),
        vstack([hstack([sparse, -one]), hstack([-sparse, -one])]),
        np.concatenate([-e, e]),
        bounds=[(-radius, radius)] * count + [(0.0, None)] * rows,
        method="highs",
    )
    return found.x[:count] if found.x is not None else np.zeros(count)


NOISES = ("Laplace", "normal with 3 % outliers", "Laplace, coloured")


def coverage(records: int) -> None:
    rows = []
    for nu, ny, modes in COVERED:
        for form in FORMS:
            for noise in NOISES if form == "ss_oe" else NOISES[:1]:
                true = truth(nu, ny, modes, form)
                hits = [_hits(true, noise, seed) for seed in range(records)]
                shares = [100 * np.mean(np.concatenate(each)) for each in zip(*hits, strict=True)]
                rows.append([f"{nu}×{ny}", NAMES[form], noise, *(f"{each:.1f}" for each in shares)])
                print(rows[-1], flush=True)
    write_section(
        "outliers",
        "Intervals of state-space models",
        f"Coverage of 95 % intervals, percent: {records} records of {SAMPLES} samples, absolute "
        "objective. Intervals of Laplace noise are rather too wide:\nthe kernel estimate of the "
        "density at zero lies below its cusp.",
        "benchmarks/absolute_channels.py coverage",
        ("channels", "form", "noise", "frequency", "damping", "responses"),
        rows,
    )


def _hits(true: StateSpaceModel, noise: str, seed: int) -> tuple[np.ndarray, ...]:
    generator = np.random.default_rng([seed, true.order, true.outputs, len(noise)])
    u = generator.standard_normal((SAMPLES + 500, true.inputs))
    scale = NOISE * true.simulate(u).std(axis=0)
    shape = (SAMPLES + 500, true.outputs)
    if noise == NOISES[1]:
        e = scale * generator.standard_normal(shape)
        e *= np.where(generator.random(shape) < 0.03, 100.0, 1.0)
    else:
        e = scale * generator.laplace(size=shape) / np.sqrt(2.0)
    if noise == NOISES[2]:
        e = lfilter([np.sqrt(1.0 - COLOUR**2)], [1.0, -COLOUR], e, axis=0)
    y, x = np.empty_like(e), np.zeros(true.order)
    for t in range(len(u)):
        y[t] = true.C @ x + e[t]
        x = true.A @ x + true.B @ u[t] + true.K @ e[t]
    model = estimated(u[500:], y[500:], true, "absolute").model
    pairs = [(nearest(model, mode), mode) for mode in true.modes()]
    frequency = [abs(m.frequency_hz - t.frequency_hz) < 1.96 * m.frequency_se_hz for m, t in pairs]
    damping = [abs(m.damping_ratio - t.damping_ratio) < 1.96 * m.damping_se for m, t in pairs]
    at = np.linspace(2.0, 45.0, 5)
    difference = model.frequency_response(at) - true.frequency_response(at)
    spread = _response_errors(model, at)
    parts = np.stack([difference.real, difference.imag], axis=-1).ravel()
    return np.array(frequency), np.array(damping), np.abs(parts) < 1.96 * spread


def _response_errors(model: StateSpaceModel, at: np.ndarray) -> np.ndarray:
    """Standard errors of real and imaginary parts of the responses, by finite differences."""
    parameters = model.parameters
    slopes = []
    for k in range(parameters.size):
        step = np.zeros(parameters.size)
        step[k] = 1e-6 * max(1.0, abs(parameters[k]))
        above, below = (
            model.with_parameters(parameters + s).frequency_response(at) for s in (step, -step)
        )
        slope = (above - below) / (2.0 * step[k])
        slopes.append(np.stack([slope.real, slope.imag], axis=-1).ravel())
    assert model.covariance is not None
    return np.asarray(model.covariance.standard_errors(np.array(slopes).T))


SECTIONS = {"errors": (errors, 10), "optimum": (optimum, 12), "coverage": (coverage, 100)}


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("section", choices=SECTIONS)
    parser.add_argument("--records", type=int)
    arguments = parser.parse_args()
    measure, records = SECTIONS[arguments.section]
    measure(arguments.records or records)


if __name__ == "__main__":
    main()
