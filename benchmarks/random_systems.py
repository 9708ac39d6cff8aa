"""Random linear systems and recordings of them, with everything that goes wrong when measuring.

A case is drawn from its number alone. It is wide on purpose: more structures, orders, delays,
lengths, inputs and faults than any rule of the package was made with. Those from number 5000 to
9999 have several channels, or no input, and are short.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import solve_toeplitz
from scipy.signal import chirp, lfilter

Array = NDArray[np.float64]
Random = np.random.Generator

STRUCTURES = ("fir", "arx", "armax", "ararx", "oe", "bj", "state space")
INPUTS = ("white", "coloured", "PRBS", "multisine", "swept", "steps", "feedback")
OUTSIDE = ("drifting", "switching", "nonlinear", "unrelated")
# Numbers of the cases of several channels or without an input, their structures, and the share
# without an input, as of an operational modal analysis.
SEVERAL, SHARE_WITHOUT_INPUT = range(5000, 10_000), 0.55
SEVERAL_STRUCTURES = ("arx", "armax", "oe", "bj")
WARM_UP = 2000
NOISE_LAGS = 30  # of the autoregression that describes the noise


def product(polynomials: Sequence[Array]) -> Array:
    """Their product, 1 of none."""
    whole = np.ones(1)
    for each in polynomials:
        whole = np.asarray(np.polymul(whole, each), dtype=float)
    return whole


class Mode(NamedTuple):
    """A pair of poles; ``share`` is its part of the energy of the response, of all channels."""

    angle: float  # rad per sample, undamped
    damping: float
    share: float
    shape: Array = np.ones(1)  # (l,), complex, of recorded outputs; NaN where the mode has several


@dataclass(frozen=True, eq=False)
class System:
    """A response as a sum of sections, beside each other, and filters of the noise.

    ``y_j = sum_ik gains[j, i, k] (q) / sections[k] (q) u_i(t - nk) + c / d (q) e_j``.
    """

    structure: str
    # Denominators of first and second order; of a finite impulse response [1.0]
    sections: tuple[Array, ...]
    gains: Array  # (l, m, k, 2): numerators of one sample less delay
    taps: Array  # (l, m, taps) of a finite impulse response, else without taps
    nk: int
    c: Array
    d: Array

    def respond(self, u: Array) -> Array:
        """Noise-free outputs (N, l), from rest."""
        parts = [part @ np.ones(len(u.T)) for part in self.parts(_late(u, self.nk))]
        return np.sum(parts, axis=0).T

    def parts(self, late: Array) -> list[Array]:
        """The responses of each section (l, N, m) to inputs that the delay has passed."""
        if self.taps.size:
            return [
                np.array([[lfilter(b, [1.0], v) for b, v in zip(row, late.T, strict=True)]
                          for row in self.taps]).transpose(0, 2, 1)
            ]  # fmt: skip
        return [
            np.array(
                [
                    [lfilter(b, a, v) for b, v in zip(row, late.T, strict=True)]
                    for row in self.gains[:, :, k]
                ]
            ).transpose(0, 2, 1)
            for k, a in enumerate(self.sections)
        ]

    @property
    def noises(self) -> int:
        """Number of sources of noise: of each output, and of driven states one more."""
        outputs = self.gains.shape[0]
        return outputs + (self.structure == "state space" and outputs > 1)

    def disturb(self, e: Array) -> Array:
        """Filtered noise (N, l); that of driven states has the shapes of the modes."""
        if self.structure != "state space":
            return lfilter(self.c, self.d, e, axis=0)
        if len(self.gains) > 1:
            alone = np.zeros((len(e), self.gains.shape[1]))
            alone[:, 0] = e[:, 0]
            states = np.sum(self.parts(alone), axis=(0, 3)).T
            return states + 0.3 * states.std(axis=0) * e[:, 1:]
        driven = np.sum(
            [
                lfilter(1.0 + self.gains[:, 0, k, :1].sum(axis=0), a, e[:, 0])
                for k, a in enumerate(self.sections)
            ],
            axis=0,
        )
        return driven[:, None] / driven.std() + 0.3 * e

    def frequency_response(self, angles: Array) -> Array:
        """Response (F, l, m) at angles in rad per sample."""
        z = np.exp(-1j * angles)
        delay = z**self.nk
        if self.taps.size:
            lags = z[:, None] ** np.arange(self.taps.shape[2])
            return np.einsum("f,ft,lmt->flm", delay, lags, self.taps)
        total = np.zeros((len(z), *self.gains.shape[:2]), complex)
        for k, a in enumerate(self.sections):
            numerators = self.gains[:, :, k, 0] + self.gains[:, :, k, 1] * z[:, None, None]
            total += numerators / np.polyval(a[::-1], z)[:, None, None]
        return total * delay[:, None, None]

    @property
    def polynomials(self) -> tuple[Array, Array]:
        """Numerator, from lag nk, and denominator from the first input to the first output."""
        if self.taps.size:
            return self.taps[0, 0], np.ones(1)
        whole = product(self.sections)
        numerator = np.zeros(len(whole))
        for k in range(len(self.sections)):
            others = [a for other, a in enumerate(self.sections) if other != k]
            rest = np.polymul(product(others), self.gains[0, 0, k])
            numerator[: len(rest)] += rest
        return numerator, whole


@dataclass(frozen=True, eq=False)
class Case:
    """A recording and what is true of it."""

    number: int
    system: System
    outside: str  # "" or how the recording leaves the class of linear systems
    input_kind: str
    faults: tuple[str, ...]
    earlier: Array  # inputs before the recording, (WARM_UP, m)
    inputs: Array  # (N, m), as recorded; without columns for an output-only record
    outputs: Array  # (N, l), as recorded
    clean: tuple[Array, Array]  # the recording before its faults
    input_scale: float
    output_scales: Array  # (l,)
    signal_to_noise: float  # standard deviations
    modes: tuple[Mode, ...]
    band: tuple[float, float]  # rad per sample, that the input excites and the modes lie in
    fed_back: float  # share of the noise in the variance of the input

    @property
    def labels(self) -> dict[str, object]:
        """What the case is, in words and numbers."""
        return {
            "structure": self.system.structure,
            "order": sum(len(a) - 1 for a in self.system.sections),
            "delay": self.system.nk,
            "samples": len(self.outputs),
            "inputs": self.inputs.shape[1],
            "outputs": self.outputs.shape[1],
            "input": self.input_kind,
            "outside": self.outside,
            "faults": list(self.faults),
            "signal_to_noise": self.signal_to_noise,
            "fed_back": self.fed_back,
        }

    def mode_errors(self) -> list[tuple[float, float]]:
        """Least relative standard errors of frequency and damping of each mode (Cramér-Rao).

        NaN where they are not known.  Without an input, those of one mode under a white force in a
        long record (Au 2014, Mech. Syst. Signal Process. 48:15).
        """
        s = self.system
        if not self.inputs.shape[1]:
            periods = [mode.angle * len(self.outputs) for mode in self.modes]
            return [
                (np.sqrt(mode.damping / count), np.sqrt(1.0 / (mode.damping * count)))
                for mode, count in zip(self.modes, periods, strict=True)
            ]
        inverse = self.spread
        found, first = [], 0
        for a in s.sections:
            n = len(a) - 1
            if n == 2:
                part = _mode_gradient(a) @ inverse[first : first + 2]
                mode = _mode(a, 0.0)
                errors = np.linalg.norm(part, axis=1) / (mode.angle, mode.damping)
                found.append((float(errors[0]), float(errors[1])))
            first += n * (1 + s.gains.shape[0] * s.gains.shape[1])
        return found

    def response_error(self, angles: Array) -> float:
        """Least relative error of the response at some angles (Cramér-Rao), the mean of all pairs.

        Root mean square over the angles; NaN where it is not known.
        """
        s, z = self.system, np.exp(-1j * angles)
        true = s.frequency_response(angles)
        rows = []
        for k, a in enumerate(s.sections):
            numerators = s.gains[:, :, k, 0] + s.gains[:, :, k, 1] * z[:, None, None]
            of_section = z[:, None, None] ** s.nk / np.polyval(a[::-1], z)[:, None, None]
            own = numerators * of_section / np.polyval(a[::-1], z)[:, None, None]
            rows += [-own * z[:, None, None] ** lag for lag in range(1, len(a))]
            for j, i in np.ndindex(true.shape[1:]):
                for lag in range(len(a) - 1):
                    row = np.zeros_like(true)
                    row[:, j, i] = (of_section * z[:, None, None] ** lag)[:, 0, 0]
                    rows.append(row)
        spread = self.spread
        covariance = spread @ spread.T
        jacobian = np.array(rows)
        variance = np.einsum("pflm,pq,qflm->lm", jacobian, covariance, jacobian.conj()).real
        return float(np.mean(np.sqrt(variance) / np.linalg.norm(true, axis=0)))

    @cached_property
    def spread(self) -> Array:
        """A square root of the least covariance of the coefficients of all sections (Cramér-Rao).

        Of the true orders and delay, from noise whose colour is known, and with a state at the
        first sample that is not.  NaN where rounding makes 20,000 samples of the noise grow, as of
        many slow poles.
        """
        return self._spread_of(self._by_coefficients())

    def delay_error(self) -> float:
        """Least standard error of the delay as a real number, in samples (Cramér-Rao).

        The coefficients of the true orders are not known either.  NaN where :attr:`spread` is.
        """
        inputs = np.vstack([self.earlier, self.clean[0]])
        sooner, later = (self.system.respond(np.roll(inputs, k, axis=0)) for k in (-1, 1))
        by_delay = 0.5 * (later - sooner)[-len(self.outputs) :].T
        return float(np.linalg.norm(self._spread_of([*self._by_coefficients(), by_delay])[-1]))

    def _by_coefficients(self) -> list[Array]:
        """Derivatives of the outputs, (l, N) each."""
        inputs = _late(np.vstack([self.earlier, self.clean[0]]), self.system.nk)
        return [part[:, -len(self.outputs) :] for part in _derivatives(self.system, inputs)]

    def _spread_of(self, columns: Sequence[Array]) -> Array:
        """A square root of the least covariance of what outputs have some derivatives by."""
        s, (u, y) = self.system, self.clean
        count = len(columns)
        columns = [*columns, *_free_responses(s, len(u))]
        noise = y - s.respond(np.vstack([self.earlier, u]))[-len(u) :]
        try:
            whitenings = self._whitenings(noise.std(axis=0))
        except (np.linalg.LinAlgError, ValueError):  # it is not finite where it overflows
            return np.full((count, 1), np.nan)
        matrix = np.column_stack(
            [
                np.concatenate(
                    [lfilter(w, [1.0], part) for w, part in zip(whitenings, column, strict=True)]
                )
                for column in columns
            ]
        )
        sizes = np.linalg.norm(matrix, axis=0)
        sizes[sizes == 0.0] = 1.0
        _, told, directions = np.linalg.svd(matrix / sizes, full_matrices=False)
        # What rounding hides is not told.
        inverse = directions.T / np.maximum(told, 1e-12 * told[0]) / sizes[:, None]
        return np.asarray(inverse[:count])

    def _whitenings(self, spread: Array) -> list[Array]:
        """Filters that make the noise of each output white, of variance 1."""
        e = np.random.default_rng(0).standard_normal((20_000, self.system.noises))
        found = []
        for v, size in zip(self.system.disturb(e)[WARM_UP:].T, spread, strict=True):
            v = v / v.std() * size
            products = [v[: len(v) - k] @ v[k:] / len(v) for k in range(NOISE_LAGS + 1)]
            a = solve_toeplitz(products[:-1], products[1:])
            w = np.concatenate([[1.0], -a])
            found.append(w / lfilter(w, [1.0], v)[NOISE_LAGS:].std())
        return found


def _derivatives(s: System, late: Array) -> Iterator[Array]:
    """Derivatives of the outputs, (l, N) each, by taps, or by the coefficients of each section."""
    outputs, inputs = s.gains.shape[:2]
    if s.taps.size:
        for j, i, lag in np.ndindex(s.taps.shape):
            column = np.zeros((outputs, len(late)))
            column[j] = late[:, i]
            yield _later(column, lag)
        return
    for k, (a, part) in enumerate(zip(s.sections, s.parts(late), strict=True)):
        driven = part.sum(axis=2)
        for lag in range(1, len(a)):
            yield -_later(lfilter([1.0], a, driven, axis=1), lag)
        for j in range(outputs):
            for i in range(inputs):
                for lag in range(len(a) - 1):
                    column = np.zeros((outputs, len(late)))
                    column[j] = lfilter([1.0], s.sections[k], late[:, i])
                    yield _later(column, lag)


def _free_responses(s: System, samples: int) -> list[Array]:
    """Responses of each output, (l, N), to a state of each section at the first sample."""
    responses = []
    for a in s.sections:
        for j in range(s.gains.shape[0]):
            column = np.zeros((s.gains.shape[0], samples))
            column[j] = lfilter([1.0], a, np.eye(1, samples)[0])
            responses += [_later(column, lag) for lag in range(len(a) - 1)]
    return responses


def _late(u: Array, nk: int) -> Array:
    """Inputs (N, m) after a delay, from rest."""
    return np.vstack([np.zeros((nk, u.shape[1])), u])[: len(u)]


def _later(rows: Array, lag: int) -> Array:
    return np.pad(rows, ((0, 0), (lag, 0)))[:, : rows.shape[1]]


def _mode_gradient(a: Array) -> Array:
    """Derivatives of angle and damping, (2, 2), by the coefficients behind the 1."""
    steps = []
    for step in 1e-7 * np.eye(3)[1:]:
        above, below = _mode(a + step, 0.0), _mode(a - step, 0.0)
        steps.append([(above[q] - below[q]) / 2e-7 for q in (0, 1)])
    return np.array(steps).T


def log_uniform(g: Random, low: float, high: float) -> float:
    """A number whose logarithm is uniform."""
    return float(np.exp(g.uniform(np.log(low), np.log(high))))


def draw_sections(g: Random, order: int, samples: int) -> tuple[Array, ...]:
    """Denominators whose fastest mode is sampled 4 to 200 times a period, the others slower."""
    angle = 2.0 * np.pi / log_uniform(g, 4.0, min(200.0, samples / 10.0))
    slowest = 2.0 * np.pi / min(1000.0, samples / 5.0)
    sections = []
    while order > 0:
        if order == 1 or g.random() < 0.15:
            sections.append(np.array([1.0, -np.exp(-max(angle * g.uniform(0.3, 1.0), slowest))]))
            order -= 1
            continue
        damping = log_uniform(g, 0.003, 0.5)
        pole = np.exp((-damping + 1j * np.sqrt(1.0 - damping**2)) * angle)
        sections.append(np.array([1.0, -2.0 * pole.real, abs(pole) ** 2]))
        order -= 2
        angle = max(angle / g.uniform(1.3, 3.0), slowest)
    return tuple(sections)


def draw_system(g: Random, structure: str, inputs: int, outputs: int, samples: int) -> System:
    """A random system of a structure."""
    order = int(g.integers(1, 11 if samples > 1000 else 7))
    nk = int(
        g.choice([0, 1, int(g.integers(2, 11)), int(g.integers(11, 61))], p=[0.1, 0.5, 0.2, 0.2])
    )
    taps = np.zeros((outputs, inputs, 0))
    sections: tuple[Array, ...] = (np.ones(1),)
    gains = np.zeros((outputs, inputs, 1, 2))
    if structure == "fir":
        count = int(g.integers(2, 20))
        taps = g.standard_normal((outputs, inputs, count)) * np.exp(-np.arange(count) / count * 2)
    else:
        sections = draw_sections(g, order, samples)
        gains = g.standard_normal((outputs, inputs, len(sections), 2))
        for k, a in enumerate(sections):
            if len(a) == 2:
                gains[:, :, k, 1] = 0.0
            # Sections of like energy: impulse responses of one norm.
            impulse = lfilter([1.0], a, np.r_[1.0, np.zeros(4000)])
            gains[:, :, k] *= g.uniform(0.3, 1.0) / np.linalg.norm(impulse)
            if structure == "state space" and len(gains) > 1:
                gains[:, :, k] = _of_one_shape(a, gains[:, :, k])
    whole = product(sections)
    roots = g.uniform(-0.9, 0.9, 2)
    own = np.poly(roots[:1]) if g.random() < 0.5 else np.poly(roots)
    slow = np.array([1.0, -g.uniform(0.5, 0.95)])
    c, d = {
        "fir": (own, np.ones(1)) if g.random() < 0.5 else (np.ones(1), np.ones(1)),
        "arx": (np.ones(1), whole),
        "armax": (np.poly(g.uniform(-0.9, 0.9, max(len(whole) - 1, 1))), whole),
        "ararx": (np.ones(1), np.polymul(whole, slow)),
        "oe": (np.ones(1), np.ones(1)),
        "bj": (own, slow),
        "state space": (np.ones(1), whole),
    }[structure]
    return System(structure, sections, gains, taps, nk, np.asarray(c, float), d)


def _residues(denominator: Array, gains: Array) -> tuple[complex, Array]:
    """A pole, and the numerators of a section, (l, m, 2), there."""
    pole = np.roots(denominator)[0]
    return pole, gains[..., 0] + gains[..., 1] / pole


def _of_one_shape(denominator: Array, gains: Array) -> Array:
    """Numerators of a single pole or pair, whose residue is of rank one, with a real shape."""
    pole, residues = _residues(denominator, gains)
    left, _, right = np.linalg.svd(residues.real)
    residues = np.outer(left[:, 0], right[0]) * (left[:, 0] @ residues @ right[0])
    slopes = residues.imag / (1.0 / pole).imag if len(denominator) == 3 else 0.0 * residues.real
    return np.stack([residues.real - slopes * (1.0 / pole).real, slopes], axis=-1)


def _shape(denominator: Array, gains: Array, scales: Array) -> Array:
    """Shape of a section's mode at the recorded outputs; NaN of a residue above rank one."""
    left, sizes, _ = np.linalg.svd(_residues(denominator, gains)[1])
    alone = len(sizes) == 1 or sizes[1] < 1e-9 * sizes[0]
    return left[:, 0] * scales if alone else np.full(len(scales), np.nan + 0j)


def draw_input(
    g: Random, kind: str, samples: int, channels: int, fastest: float
) -> tuple[Array, float]:
    """Inputs (samples, channels), and the angle up to which they excite the system."""
    top = min(np.pi, 2.0 * fastest)
    hold = int(g.integers(1, max(2, int(np.pi / top) + 1)))
    t = np.arange(samples)
    columns = []
    for _ in range(channels):
        if kind == "coloured":
            pole = np.exp(-top)
            columns.append(lfilter([1.0], [1.0, -pole], g.standard_normal(samples)))
        elif kind == "PRBS":
            columns.append(np.repeat(g.choice([-1.0, 1.0], samples // hold + 1), hold)[:samples])
        elif kind == "multisine":
            lines = np.unique(np.linspace(1, max(8, top / np.pi * samples / 2), 200).astype(int))
            phases = g.uniform(0, 2 * np.pi, len(lines))
            columns.append(
                sum(
                    np.cos(2 * np.pi * k * t / samples + p)
                    for k, p in zip(lines, phases, strict=True)
                )
            )
        elif kind == "swept":
            columns.append(
                chirp(t, 0.002 * g.random(), samples, 0.5 * top / np.pi, phi=360 * g.random())
            )
        elif kind == "steps":
            length = max(2, samples // int(g.integers(12, 60)))
            columns.append(np.repeat(g.standard_normal(samples // length + 1), length)[:samples])
        else:
            columns.append(g.standard_normal(samples))
    u = np.column_stack(columns)
    return u / u.std(axis=0), np.pi / hold if kind == "PRBS" else top


def closed_loop(
    g: Random, system: System, reference: Array, v: Array
) -> tuple[Array, Array, float] | None:
    """Input and output of one channel each under proportional feedback, where one is stable.

    And the share of the noise in the variance of the input.
    """
    b, f = system.polynomials
    delayed = np.concatenate([np.zeros(system.nk), b])
    long = max(len(delayed), len(f))
    forward, own = np.zeros((2, long))
    forward[: len(delayed)], own[: len(f)] = delayed, f
    gain = g.choice([-1.0, 1.0]) * log_uniform(g, 0.1, 2.0) / max(abs(b).max(), 1e-12)
    for _ in range(12):
        loop = own + gain * forward
        if abs(np.roots(loop)).max(initial=0.0) < 0.999:
            of_noise = lfilter(f, loop, v[:, 0])
            y = lfilter(delayed, loop, reference[:, 0]) + of_noise
            u = reference[:, 0] - gain * y
            share = np.var(gain * of_noise[WARM_UP:]) / np.var(u[WARM_UP:])
            return u[:, None], y[:, None], float(share)
        gain /= 2.0
    return None


def outside_of_class(g: Random, kind: str, system: System, u: Array) -> Array:
    """The response of a system that is not linear, or not constant, or that there is none of."""
    if kind == "unrelated":
        return lfilter(
            [1.0], [1.0, -0.98], g.standard_normal((len(u), system.gains.shape[0])), axis=0
        )
    if kind == "nonlinear":
        return system.respond(np.tanh(g.uniform(1.0, 2.0) * u) + 0.3 * g.random() * u**2)
    factor = 1.0 + g.choice([-1.0, 1.0]) * g.uniform(0.1, 0.3)
    changed = replace(
        system,
        sections=tuple(_faster(a, factor) for a in system.sections),
        gains=system.gains * g.uniform(0.5, 1.0),
        taps=system.taps * g.uniform(0.3, 0.6),
    )
    share = np.linspace(0.0, 1.0, len(u) - WARM_UP)
    if kind == "switching":
        share = (share > g.uniform(0.3, 0.7)).astype(float)
    weight = np.concatenate([np.zeros(WARM_UP), share])[:, None]
    return (1.0 - weight) * system.respond(u) + weight * changed.respond(u)


def _faster(a: Array, factor: float) -> Array:
    roots = np.roots(a)
    return np.real(np.poly(abs(roots) * np.exp(1j * np.angle(roots) * factor)))


def draw_case(number: int) -> Case:
    """The case of a number."""
    g = np.random.default_rng(np.random.SeedSequence(20, spawn_key=(number,)))
    if number in SEVERAL:
        return _several_channels(g, number)
    outside = str(g.choice(OUTSIDE)) if g.random() < 0.2 else ""
    structure, kind = str(g.choice(STRUCTURES)), str(g.choice(INPUTS))
    outputs = int(g.choice([1, 2, 3], p=[0.8, 0.1, 0.1]))
    inputs = int(g.choice([0, 1, 2, 3], p=[0.08, 0.76, 0.1, 0.06]))
    if kind == "feedback":
        inputs, outputs, outside = 1, 1, ""
    if inputs == 0:
        structure, kind, outside = "armax", "white", ""
    samples = round(log_uniform(g, 200.0, 10_000.0))
    system = draw_system(g, structure, max(inputs, 1), outputs, samples)
    if kind == "feedback" and system.nk == 0:
        system = replace(system, nk=1)
    return _recorded(g, number, system, kind, outside, inputs, samples)


def _several_channels(g: Random, number: int) -> Case:
    """A short recording of several channels, or of outputs alone whose forces are white."""
    samples = round(log_uniform(g, 500.0, 2000.0))
    if g.random() < SHARE_WITHOUT_INPUT:
        outputs, modes = int(g.integers(1, 9)), int(g.integers(2, 7))
        system = draw_structure(g, modes, outputs, int(g.choice([1, outputs])))
        return _recorded(g, number, system, "white", "", 0, samples)
    outputs, inputs = ((2, 1), (1, 2), (2, 2), (3, 2))[int(g.integers(4))]
    outside = str(g.choice(OUTSIDE)) if g.random() < 0.15 else ""
    structure = "state space" if g.random() < 0.5 else str(g.choice(SEVERAL_STRUCTURES))
    kind = str(g.choice(INPUTS[:-1]))
    system = draw_system(g, structure, inputs, outputs, min(samples, 1000))
    return _recorded(g, number, system, kind, outside, inputs, samples)


def draw_structure(g: Random, modes: int, outputs: int, forces: int) -> System:
    """A vibrating structure: lightly damped modes of real shapes under unknown forces."""
    angles = np.sort([2.0 * np.pi / log_uniform(g, 2.5, 50.0) for _ in range(modes)])
    dampings = np.array([log_uniform(g, 0.003, 0.05) for _ in angles])
    poles = np.exp((-dampings + 1j * np.sqrt(1.0 - dampings**2)) * angles)
    sections = tuple(np.array([1.0, -2.0 * pole.real, abs(pole) ** 2]) for pole in poles)
    gains = g.standard_normal((outputs, forces, modes, 2))
    for k, a in enumerate(sections):
        impulse = lfilter([1.0], a, np.r_[1.0, np.zeros(4000)])
        gains[:, :, k] = _of_one_shape(a, gains[:, :, k])
        gains[:, :, k] *= g.uniform(0.3, 1.0) / np.linalg.norm(gains[:, :, k])
        gains[:, :, k] /= np.linalg.norm(impulse)
    none, whole = np.zeros((outputs, forces, 0)), product(sections)
    return System("state space", sections, gains, none, 1, np.ones(1), whole)


def _recorded(
    g: Random, number: int, system: System, kind: str, outside: str, inputs: int, samples: int
) -> Case:
    """The recording of a system; without inputs its forces are not recorded."""
    outputs, forces = system.gains.shape[:2]
    angles = [abs(np.log(np.roots(a)[0] + 0j)) for a in system.sections if len(a) > 1] or [1.0]
    u, top = draw_input(g, kind, samples + WARM_UP, forces, max(angles))
    ratio = log_uniform(g, 0.5, 100.0)
    e = g.standard_normal((samples + WARM_UP, system.noises))
    y = outside_of_class(g, outside, system, u) if outside else system.respond(u)
    v = system.disturb(e)
    sizes = y[WARM_UP:].std(axis=0) / ratio / v[WARM_UP:].std(axis=0)
    # What passes states keeps their shapes.
    v *= sizes.mean() if system.noises > outputs else sizes
    looped = closed_loop(g, system, u, v) if kind == "feedback" else None
    fed_back = 0.0
    if inputs == 0:
        # The forces are not measured, and the noise is that of the sensor.
        y = y + y.std(axis=0) / ratio * e[:, :outputs]
    elif looped is None:
        y, kind = y + v, "white" if kind == "feedback" else kind
    else:
        u, y, fed_back = looped
    parts = system.parts(_late(u, system.nk))
    energies = [float(np.sum(np.var(part[:, WARM_UP:], axis=1))) for part in parts]
    earlier, u, y = u[:WARM_UP, :inputs], u[WARM_UP:, :inputs], y[WARM_UP:]
    modes = tuple(
        _mode(a, energy / sum(energies))
        for a, energy in zip(system.sections, energies, strict=True)
        if len(a) == 3
    )
    band = float(min(angles) / 3.0), float(min(top, 2.0 * max(angles), 0.9 * np.pi))
    clean, ones = (u.copy(), y.copy()), np.ones(outputs)
    case = Case(
        *(number, system, outside, kind, (), earlier, u, y, clean, 1.0, ones, ratio, modes),
        *(band, fed_back),
    )
    return _measured(g, case)


def _mode(denominator: Array, share: float) -> Mode:
    rate = np.log(np.roots(denominator)[0])
    return Mode(float(abs(rate)), float(-rate.real / abs(rate)), share)


def _measured(g: Random, case: Case) -> Case:
    """The recording of a case with units, offsets, drift, outliers and missing samples."""
    u, y = case.inputs.copy(), case.outputs.copy()
    faults, count = [], len(y)
    spread = y.std(axis=0)
    if g.random() < 0.15:
        faults.append("drift")
        t = np.linspace(0.0, 1.0, count)[:, None]
        walk = np.cumsum(g.standard_normal((count, 1)), axis=0)
        shape = (t, np.sin(2 * np.pi * g.uniform(0.5, 2.0) * t), walk)[int(g.integers(3))]
        y += g.uniform(0.2, 1.0) * spread * (shape - shape.mean()) / shape.std()
    if g.random() < 0.1:
        faults.append("outliers")
        hit = g.random(y.shape) < 0.005
        y += hit * 10.0 * spread * g.standard_normal(y.shape)
    input_scale, output_scales = 1.0, np.ones(y.shape[1])
    if g.random() < 0.5:
        faults.append("offsets")
        u += 5.0 * g.standard_normal(u.shape[1])
        y += 5.0 * spread * g.standard_normal(y.shape[1])
    if g.random() < 0.3:
        faults.append("units")
        input_scale = log_uniform(g, 1e-5, 1e5)
        output_scales = np.array([log_uniform(g, 1e-5, 1e5) for _ in y.T])
    u, y = u * input_scale, y * output_scales
    if g.random() < 0.1:
        faults.append("missing samples")
        if g.random() < 0.3:
            y[g.random(count) < 0.01] = np.nan
        else:
            first = int(g.integers(count // 10, count - count // 10))
            y[first : first + max(1, count // 50)] = np.nan
    pairs = [k for k, a in enumerate(case.system.sections) if len(a) == 3]
    return replace(
        case,
        faults=tuple(faults),
        modes=tuple(
            mode._replace(
                shape=_shape(case.system.sections[k], case.system.gains[:, :, k], output_scales)
            )
            for k, mode in zip(pairs, case.modes, strict=True)
        ),
        inputs=u,
        outputs=y,
        input_scale=input_scale,
        output_scales=output_scales,
    )
