"""Can the 2 Hz mode of the simulated arm be found?  Cramér-Rao bounds of the exact structure.

    PYTHONPATH=workflow/scripts python benchmarks/arm_bound.py

After two differences the arm, its disturbance, sensor noise and drift are exactly an ARMAX model:
ARMAX(8, 10, 10, 3) where the output alone is differenced, ARMAX(8, 8, 10, 3) where both channels
are.  The information of one sample is an integral over frequency (Ljung 1999, section 9.4), so the
bounds need no simulation.  ``contrast`` is the mode's noncentrality: the expected fall of minus
twice the log-likelihood, with all other parameters estimated again, that its four parameters bring;
BIC asks for 4 ln N.  The bounds are for the sensor's characteristic taken back.

Then exact structures with and without the mode are fitted to records, from the true parameters.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import expm
from scipy.signal import ss2tf

from evopem.automatic.fit import FitSettings, fit
from evopem.models.polynomial import PolynomialModel
from evopem.models.polynomials import root_gradient
from evopem.models.structures import Orders
from evopem.signals.recording import Segment
from evopem.signals.transforms import box_cox
from evopem.synthesis.flexible_arm import (
    ARM_MODES,
    CHARACTERISTIC,
    DISTURBANCE,
    DRIFT_STEP,
    SENSOR_NOISE,
    arm_dynamics,
    flexible_arm,
)

Array = NDArray[np.float64]

RATE, SAMPLES, DELAY = 100.0, 4000, 3
FREQUENCIES = 1 << 17
RECORDS = 12
TWICE = np.array([1.0, -2.0, 1.0])
MODE_HZ = ARM_MODES[0][0]


def plant() -> tuple[Array, Array]:
    """A and the eight coefficients of B, the first at lag 3, of the signals themselves."""
    a, b, c = arm_dynamics()
    states = len(a)
    block = np.zeros((states + 2, states + 2))
    block[:states, :states], block[:states, states:] = a, b
    step = expm(block / RATE)
    numerator, denominator = ss2tf(
        step[:states, :states], step[:states, states : states + 1], c[None, :], np.zeros((1, 1))
    )
    return denominator, numerator[0, 1:]


def noise(a: Array, b: Array) -> tuple[Array, float]:
    """C and the variance of e, by spectral factorisation of the noise of differenced outputs."""
    z = np.exp(-2j * np.pi * np.arange(FREQUENCIES) / FREQUENCIES)
    gain = np.abs(np.polyval(b[::-1], z) / np.polyval(a[::-1], z)) ** 2
    spread = np.sqrt((1.0 + DISTURBANCE**2) * np.mean(gain))
    terms = (
        DISTURBANCE * np.convolve(TWICE, b),
        SENSOR_NOISE * spread * np.convolve(TWICE, a),
        DRIFT_STEP * spread * a,
    )
    length = max(map(len, terms))
    symmetric = np.zeros(2 * length - 1)
    for each in terms:
        padded = np.concatenate([each, np.zeros(length - len(each))])
        symmetric += np.convolve(padded, padded[::-1])
    found = np.roots(symmetric)
    inside = found[np.argsort(np.abs(found))][: length - 1]
    c = np.real(np.poly(inside))
    return c, float(symmetric[length - 1] / (c @ c))


def information(a: Array, b: Array, c: Array, variance: float, input_differenced: bool) -> Array:
    """Information of one sample on ``[a_1.., b_0.., c_1..]``."""
    z = np.exp(-2j * np.pi * (np.arange(FREQUENCIES) + 0.5) / FREQUENCIES)
    on_a, on_b, on_c = (np.polyval(each[::-1], z) for each in (a, b, c))
    of_input = np.abs(np.polyval(TWICE[::-1], z)) if input_differenced else np.ones(len(z))
    lags = [z**k for k in range(max(len(a), len(b), len(c)) + 1)]
    u_part, e_part = [], []
    for i in range(1, len(a)):
        u_part.append(lags[i] * on_b * z**DELAY / on_a / on_c * of_input)
        e_part.append(lags[i] / on_a)
    for j in range(len(b)):
        u_part.append(-lags[j] * z**DELAY / on_c * of_input)
        e_part.append(np.zeros(len(z), dtype=complex))
    for k in range(1, len(c)):
        u_part.append(np.zeros(len(z), dtype=complex))
        e_part.append(-lags[k] / on_c)
    u_rows, e_rows = np.array(u_part), np.array(e_part)
    both = u_rows @ u_rows.conj().T / variance + e_rows @ e_rows.conj().T
    return np.real(both) / len(z)


def bounds(b: Array, a: Array, c: Array, variance: float, input_differenced: bool) -> list[str]:
    """Standard errors of the mode by the bound for one record, and its contrast."""
    poles = np.roots(a)
    target = poles[np.argmin(np.abs(poles - np.exp(2j * np.pi * MODE_HZ / RATE)))]
    gradient = root_gradient(a, target)[1:]
    matrix = SAMPLES * information(a, b, c, variance, input_differenced)
    scale = 1.0 / np.sqrt(np.diag(matrix))
    covariance = np.linalg.inv(matrix * np.outer(scale, scale)) * np.outer(scale, scale)
    s = np.log(target) * RATE
    by_s = gradient / target * RATE
    of_frequency = np.real(np.conj(s) * by_s) / abs(s) / (2 * np.pi)
    of_damping = -by_s.real / abs(s) + s.real * np.real(np.conj(s) * by_s) / abs(s) ** 3
    inner = covariance[: len(a) - 1, : len(a) - 1]
    return [f"{np.sqrt(g @ inner @ g):.3g}" for g in (of_frequency, 100.0 * of_damping)] + [
        f"{contrast(a, b, c, variance, input_differenced):.1f}"
    ]


def contrast(a: Array, b: Array, c: Array, variance: float, input_differenced: bool) -> float:
    """Smallest expected fall of -2 log-likelihood from the nearest model without the mode.

    The nearest model of the reduced structure minimises the same integral; Gauss-Newton from the
    true model with the mode's poles removed from A and the nearest zeros from B and C.
    """
    from scipy.optimize import least_squares

    z = np.exp(-2j * np.pi * (np.arange(1 << 14) + 0.5) / (1 << 14))
    of_input = np.abs(np.polyval(TWICE[::-1], z)) if input_differenced else np.ones(len(z))

    def on(polynomial: Array) -> NDArray[np.complex128]:
        return np.polyval(polynomial[::-1], z)

    plant_true = on(b) * z**DELAY / on(a) * of_input
    noise_true = np.sqrt(variance) * on(c) / on(a)
    poles = np.roots(a)
    near = np.abs(np.abs(np.angle(poles)) - 2 * np.pi * MODE_HZ / RATE) < 0.02

    def without_two(polynomial: Array) -> Array:
        zeros = np.roots(polynomial)
        order = np.argsort(np.abs(zeros - poles[near][np.imag(poles[near]) > 0][0]))
        first = zeros[order[0]]
        kept = np.abs(zeros - first) > 1e-9
        kept &= np.abs(zeros - first.conjugate()) > 1e-9
        return polynomial[0] * np.real(np.poly(zeros[kept]))

    start = (np.real(np.poly(poles[~near])), without_two(b), without_two(c))
    sizes = [len(start[0]) - 1, len(start[1]), len(start[2]) - 1]

    def polynomials(point: Array) -> tuple[Array, Array, Array]:
        p, q, r = np.split(point, np.cumsum(sizes)[:-1])
        one = np.ones(1)
        return np.concatenate([one, p]), q, np.concatenate([one, r])

    def errors(point: Array) -> Array:
        p, q, r = polynomials(point)
        inverse = on(p) / on(r)
        of_u = inverse * (plant_true - on(q) * z**DELAY / on(p) * of_input)
        of_e = inverse * noise_true
        return np.concatenate([of_u.real, of_u.imag, of_e.real, of_e.imag]) / np.sqrt(len(z))

    point = np.concatenate([start[0][1:], start[1], start[2][1:]])
    found = least_squares(errors, point, x_scale="jac", method="trf", max_nfev=300)
    p, _, r = polynomials(found.x)
    if np.max(np.abs(np.roots(r))) >= 1.0 or np.max(np.abs(np.roots(p))) >= 1.0:
        return float("nan")
    return SAMPLES * float(np.log(2.0 * found.cost / variance))


def fitted(seed: int, a: Array, b: Array, c: Array, variance: float) -> tuple[float, float, float]:
    """Fall of the BIC that the mode brings (not divided), and the nearest mode, in one record."""
    recording, _ = flexible_arm(seed, SAMPLES + 2)
    output = box_cox(recording.output, CHARACTERISTIC, 0.0)
    u, y = np.diff(recording.input, 2), np.diff(output, 2)
    gain = 1.0 / y.std()
    stretch, one = Segment(u, gain * y), np.ones(1)
    record_gain = gain * float(np.std(y)) / _output_deviation(a, b, c, variance)
    truth = PolynomialModel(a, record_gain * b, c, one, one, DELAY)
    values = []
    for order in (8, 6):
        orders = Orders(na=order, nb=order, nc=order + 2, nk=DELAY)
        found = fit([stretch], orders, FitSettings("quadratic", level=False), [truth])
        e = found.residuals_from(100)
        values.append((len(e) * np.log(np.mean(e**2)) + orders.parameters * np.log(len(e)), found))
    modes = [(RATE * m.frequency_hz, m.damping_ratio) for m in values[0][1].model.modes()]
    nearest = min(modes, key=lambda m: abs(np.log(m[0] / MODE_HZ)))
    return values[1][0] - values[0][0], nearest[0], 100.0 * nearest[1]


def _output_deviation(a: Array, b: Array, c: Array, variance: float) -> float:
    z = np.exp(-2j * np.pi * (np.arange(FREQUENCIES) + 0.5) / FREQUENCIES)
    on_a, on_b, on_c = (np.polyval(each[::-1], z) for each in (a, b, c))
    of_input = np.abs(np.polyval(TWICE[::-1], z) * on_b / on_a) ** 2
    return float(np.sqrt(np.mean(of_input + variance * np.abs(on_c / on_a) ** 2)))


def main() -> None:
    """Print the bounds of three preparations, and what fits of the exact structure find."""
    a, b = plant()
    c, variance = noise(a, b)
    print("| preparation | frequency, Hz | damping, % | contrast | 4 ln N |")
    print("|---|---|---|---|---|")
    needed = f"{4 * np.log(SAMPLES):.1f}"
    for name, numerator, differenced in (
        ("output differenced twice, ARMAX(8,10,10,3)", np.convolve(TWICE, b), False),
        ("both channels differenced twice, ARMAX(8,8,10,3)", b, True),
    ):
        cells = bounds(numerator, a, c, variance, differenced)
        print(f"| {name} | {' | '.join(cells)} | {needed} |", flush=True)
    print("\n| record | fall of the BIC by the mode | nearest mode, Hz | damping, % |")
    print("|---|---|---|---|")
    for seed in range(1, RECORDS + 1):
        fall, frequency, damping = fitted(seed, a, b, c, variance)
        print(f"| {seed} | {fall:.1f} | {frequency:.3f} | {damping:.1f} |", flush=True)


if __name__ == "__main__":
    main()
