"""The modes of one structure from several set-ups, which have some channels in common.

Each set-up has a maximum-likelihood model of its channels, with its own noise and excitation.
The likelihood of all under common poles, shapes and drives is, to first order, that of their
estimates with their covariances: its maximum solves a generalised least-squares problem, in which
common channels scale every set-up, weighed by what it knows (asymptotic least squares, Gourieroux,
Monfort & Trognon 1985; re-scaling by references, Doehler & Mevel 2012).
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import Self

import numpy as np
import scipy  # whose parts load on first use

from evopem.arrays import Array, Complex, Flags, Indices
from evopem.errors import InputError
from evopem.models.modes import Mode
from evopem.models.setups import INPUT, Setup, check_setups, common_modes

FALSE_ALARMS = 0.05  # probability that any set-up is said to contradict the others where none does
# Least eigenvalue of a correlation, and share of a set-up in what others know, beyond rounding.
ROUNDING, SHARED = 1e-9, 1e-6
# Factor of the covariance of a set-up that is as good as left out.
IGNORED = 1e8
STEPS, HALVINGS, CONVERGED = 50, 12, 1e-8

Groups = Sequence[Mapping[int, int]]  # index of each mode in the set-ups that have it


@dataclass(frozen=True)
class Contradiction:
    """A set-up that does not fit the others, and where it does so most."""

    setup: str
    p_value: float  # of the hypothesis that it has the structure of the others
    mode: int  # row of the merged modes
    quantity: str  # frequency, damping, or the shape at a channel
    value: float  # in the set-up
    joint: float  # of the others
    standard_errors: float  # of the difference, in these


@dataclass(frozen=True, eq=False)
class MergedModes:
    """The modes that at least two set-ups and half of them have, by frequency."""

    setups: tuple[Setup, ...]
    outputs: tuple[str, ...]
    inputs: tuple[str, ...]
    # Shapes, and drives in continuous time; NaN where no set-up has both the channel and the mode
    modes: tuple[Mode, ...]
    drive_errors: tuple[Complex, ...]  # standard errors of real and imaginary parts
    by_setup: tuple[tuple[Mode | None, ...], ...]  # each mode as every set-up has it
    contradictions: tuple[Contradiction, ...]


def merge_setups(setups: Sequence[Setup]) -> MergedModes:
    """Merge the modes of set-ups with common channels, which have the same names.

    A set-up that contradicts the others stays, with errors enlarged until it agrees; of two, both
    are enlarged alike.  InputError where there are fewer than two set-ups, nothing connects them,
    or no mode is common.
    """
    check_setups(setups)
    groups = common_modes(setups)
    if not groups:
        problem = "no mode was found in two of them and in half of all"
        raise InputError("set-ups", problem, "see the modes of each one")
    channels = list(dict.fromkeys(name for setup in setups for name in setup.channels))
    channels.sort(key=lambda name: name[0] == INPUT)
    having = [k for k in range(len(setups)) if any(k in group for group in groups)]
    given = {k: _Part.of(k, setups[k], groups, channels) for k in having}
    parts, structure = given, _Structure.of(setups, groups, channels)
    contradictions: dict[int, Contradiction] = {}
    names = [name.removeprefix(INPUT) for name in channels]
    while True:
        structure = structure.fitted(parts)
        apart = {k: structure.apart(part) for k, part in parts.items() if k not in contradictions}
        p_values = {
            k: float(scipy.stats.chi2.logsf(np.sum(d / s), len(d))) for k, (d, s) in apart.items()
        }
        if min(p_values.values(), default=0.0) >= np.log(FALSE_ALARMS / len(setups)):
            break
        # That without which the others agree best; of the last two, each contradicts the other.
        fits = {k: structure.fitted(parts | {k: parts[k].enlarged(IGNORED)}) for k in p_values}
        squares = {k: fit.squares(parts) for k, fit in fits.items()}
        worst = min(fits, key=lambda k: sum(squares[k].values()) - squares[k][k])
        both = len(p_values) == 2
        for k in p_values if both else [worst]:
            p, differs = float(np.exp(p_values[k])), given[k].worst(fits[k], names)
            contradictions[k] = Contradiction(setups[k].name, p, *differs)
            parts = parts | {k: parts[k].enlarged(_enlargement(*apart[k], both))}
    structure, outputs = structure.referred().fitted(parts), int(np.sum(~structure.is_input))
    modes, drive_errors = structure.modes(setups[0].rate, outputs)
    by_setup = [
        tuple(setup.modes[group[at]] if at in group else None for at, setup in enumerate(setups))
        for group in groups
    ]
    return MergedModes(
        setups=tuple(setups),
        outputs=tuple(names[:outputs]),
        inputs=tuple(names[outputs:]),
        modes=modes,
        drive_errors=drive_errors,
        by_setup=tuple(by_setup),
        contradictions=tuple(contradictions.values()),
    )


def _enlargement(squares: Array, variances: Array, both: bool) -> float:
    """How many times as large the variances of a set-up have to be for it to agree with the others.
    The sum of ``squares`` of differences over their variances is then their number (Birge 1932). Of
    ``variances`` 1 is the set-up's, the rest the others'; with ``both`` these grow as well."""

    def excess(ratio: float) -> float:
        enlarged = ratio * variances if both else variances + ratio - 1.0
        return float(np.sum(squares / enlarged)) - len(squares)

    if not excess(1.0) > 0.0:
        return 1.0
    return float(scipy.optimize.brentq(excess, 1.0, 1.0 + np.sum(squares)))


def _started(setups: Sequence[Setup], group: Mapping[int, int], channels: list[str]) -> Complex:
    """Shape and drives of a mode from set-ups one after the other; NaN where none has a channel."""
    shape = np.full(len(channels), np.nan + 0j)
    for place, index in group.items():
        setup = setups[place]
        at = np.array([channels.index(name) for name in setup.channels])
        drives = np.arange(len(at)) >= len(setup.outputs)
        mine, theirs = setup.values[index][2:], shape[at]
        common = np.isfinite(theirs)
        known = common & ~drives if np.any(common & ~drives) else common
        scale = 1.0 + 0.0j
        if known.any():
            scale = np.vdot(mine[known], theirs[known]) / np.vdot(mine[known], mine[known])
            scale = 1.0 / scale if drives[known].all() else scale
        scaled = np.where(drives, mine / scale, mine * scale)
        shape[at[~common]] = scaled[~common]
    return shape


@dataclass(frozen=True, eq=False)
class _Structure:
    """Poles, shapes and drives of the merged modes.

    As a vector of parameters they are, of each mode: frequency, damping ratio, real and imaginary
    parts of the entries of its channels without its reference, whose entry is 1.
    """

    poles: Array  # (modes, 2) frequencies and damping ratios
    shapes: Complex  # (modes, channels) outputs, then inputs
    is_input: Flags  # (channels,)
    free: tuple[Indices, ...]  # channels of each mode without its reference
    factor: Array  # of the covariance of the parameters

    @classmethod
    def of(cls, setups: Sequence[Setup], groups: Groups, channels: list[str]) -> Self:
        """From the set-ups one after the other."""
        is_input = np.array([name[0] == INPUT for name in channels])
        shapes = np.array([_started(setups, group, channels) for group in groups])
        poles = [
            np.mean([setups[at].values[k][:2].real for at, k in group.items()], axis=0)
            for group in groups
        ]
        return cls(np.array(poles), shapes, is_input, (), np.empty((0, 0))).referred()

    def referred(self) -> Self:
        """With the largest output of each mode as its reference."""
        sizes = np.where(self.is_input | np.isnan(self.shapes), 0.0, np.abs(self.shapes))
        largest = np.argmax(sizes, axis=1)[:, None]
        scales = np.take_along_axis(self.shapes, largest, axis=1)
        shapes = np.where(self.is_input, self.shapes * scales, self.shapes / scales)
        is_free = np.isfinite(shapes) & (np.arange(shapes.shape[1]) != largest)
        return replace(self, shapes=shapes, free=tuple(map(np.flatnonzero, is_free)))

    @property
    def spans(self) -> list[tuple[int, int]]:
        """Where the parameters of each mode begin and end."""
        return list(pairwise([0, *np.cumsum([2 + 2 * len(free) for free in self.free]).tolist()]))

    def moved(self, step: Array) -> Self:
        """After a step of the parameters."""
        poles, shapes = self.poles.copy(), self.shapes.copy()
        for mode, (first, stop) in enumerate(self.spans):
            poles[mode] += step[first : first + 2]
            real, imaginary = np.split(step[first + 2 : stop], 2)
            shapes[mode, self.free[mode]] += real + 1j * imaginary
        return replace(self, poles=poles, shapes=shapes)

    def seen(self, part: "_Part") -> tuple[Array, Array]:
        """Values that a set-up has to show, and their derivatives by the parameters."""
        values, slopes = [], []
        for mode, places, scale in zip(part.modes, part.places, part.scales, strict=True):
            first, stop = self.spans[mode]
            shape, of_shape = self._scaled(self.shapes[mode], places, scale)
            values += [self.poles[mode], shape.real, shape.imag]
            rows = np.zeros((2 + 2 * len(places), self.spans[-1][1]))
            rows[:2, first : first + 2] = np.eye(2)
            d = of_shape[:, self.free[mode]]
            rows[2:, first + 2 : stop] = np.block([[d.real, -d.imag], [d.imag, d.real]])
            slopes.append(rows)
        return np.concatenate(values), np.vstack(slopes)

    def _scaled(self, shape: Complex, places: Indices, scale: int) -> tuple[Complex, Complex]:
        """Entries where the one at ``scale`` is 1, drives by its inverse, and derivatives."""
        of_input, at = self.is_input[places], shape[scale]
        slopes = np.zeros((len(places), len(shape)), dtype=complex)
        slopes[np.arange(len(places)), places] = np.where(of_input, at, 1.0 / at)
        slopes[:, scale] += np.where(of_input, shape[places], -shape[places] / at**2)
        return np.where(of_input, shape[places] * at, shape[places] / at), slopes

    def fitted(self, parts: Mapping[int, "_Part"]) -> Self:
        """The maximum of the likelihood, by Gauss-Newton steps."""
        count = self.spans[-1][1]

        def left(fit: Self) -> Array:
            return np.vstack([part.whitened(fit) for part in parts.values()])

        fit, rows = self, left(self)
        for _ in range(STEPS):
            triangle = np.asarray(np.linalg.qr(rows, mode="r"), dtype=float)
            inverse: Array = np.linalg.inv(triangle[:count, :count])
            fit, step = replace(fit, factor=inverse), inverse @ triangle[:count, -1]
            if np.linalg.norm(triangle[:count, -1]) < CONVERGED:
                break
            for _ in range(HALVINGS):
                after = left(fit.moved(step))
                if np.linalg.norm(after[:, -1]) <= np.linalg.norm(rows[:, -1]):
                    break
                step = 0.5 * step
            else:
                break
            fit, rows = fit.moved(step), after
        return fit

    def squares(self, parts: Mapping[int, "_Part"]) -> dict[int, float]:
        """Sum of squares that each part leaves over, in its errors."""
        return {k: float(np.sum(part.whitened(self)[:, -1] ** 2)) for k, part in parts.items()}

    def apart(self, part: "_Part") -> tuple[Array, Array]:
        """Squares of independent differences of a set-up from a fit to all others, and variances.

        In its errors; theirs are in the variances.  Both are what the fit with it says (deletion).
        """
        rows = part.whitened(self)
        half = rows[:, :-1] @ self.factor
        sizes, directions = np.linalg.eigh(np.eye(len(rows)) - half @ half.T)
        kept = sizes > SHARED
        along = directions[:, kept].T @ rows[:, -1] / sizes[kept]
        return along**2, 1.0 / sizes[kept]

    def modes(self, rate: float, outputs: int) -> tuple[tuple[Mode, ...], tuple[Complex, ...]]:
        """The modes, and the standard errors of their drives."""
        modes, drives = [], []
        for (first, stop), (frequency, damping), free, shape in zip(
            self.spans, self.poles.tolist(), self.free, self.shapes, strict=True
        ):
            errors = np.linalg.norm(self.factor[first:stop], axis=1)
            both = np.where(np.isnan(shape), np.nan + 0j, 0.0)
            both[free] = errors[2 : 2 + len(free)] + 1j * errors[2 + len(free) :]
            s = 2.0 * np.pi * frequency * (1j * np.sqrt(1.0 - damping**2) - damping)
            modes.append(
                Mode(
                    frequency_hz=frequency,
                    damping_ratio=damping,
                    pole=complex(np.exp(s / rate)),
                    frequency_se_hz=float(errors[0]),
                    damping_se=float(errors[1]),
                    shape=shape[:outputs],
                    shape_se_real=both.real[:outputs],
                    shape_se_imag=both.imag[:outputs],
                    input_participation=shape[outputs:],
                    output_shares=np.full(outputs, np.nan),
                )
            )
            drives.append(both[outputs:])
        return tuple(modes), tuple(drives)


@dataclass(frozen=True, eq=False)
class _Part:
    """What one set-up says of the merged modes that it has."""

    modes: tuple[int, ...]  # rows of the merged modes
    places: tuple[Indices, ...]  # channels of each, without that whose entry is 1
    scales: tuple[int, ...]  # which is this one
    values: Array  # frequency, damping ratio, real and imaginary parts of the channels; each mode
    factor: Array  # of their covariance
    whitener: Array

    @classmethod
    def of(cls, place: int, setup: Setup, groups: Groups, channels: list[str]) -> Self:
        """The part of a set-up."""
        at = np.array([channels.index(name) for name in setup.channels])
        modes = [mode for mode, group in enumerate(groups) if place in group]
        values, factors, places, scales = list[Array](), list[Array](), [], []
        for mode in modes:
            index = groups[mode][place]
            largest = int(np.argmax(np.abs(setup.modes[index].shape)))
            kept = np.arange(len(at)) != largest
            places.append(at[kept])
            scales.append(int(at[largest]))
            for parts, given in ((values, setup.values[index]), (factors, setup.errors[index])):
                parts += [given[:2].real, given[2:][kept].real, given[2:][kept].imag]
        factor = np.vstack(factors)
        scale = np.linalg.norm(factor, axis=1)
        sizes, directions = np.linalg.eigh((factor / scale[:, None]) @ (factor / scale[:, None]).T)
        whitener = (directions / np.sqrt(np.maximum(sizes, ROUNDING))).T / scale
        return cls(
            tuple(modes), tuple(places), tuple(scales), np.concatenate(values), factor, whitener
        )

    def whitened(self, structure: _Structure) -> Array:
        """Derivatives by the parameters and, behind them, what is left; errors of unit variance."""
        values, rows = structure.seen(self)
        return np.asarray(self.whitener @ np.column_stack([rows, self.values - values]))

    def enlarged(self, ratio: float) -> Self:
        """With a covariance so many times as large."""
        return replace(self, whitener=self.whitener / np.sqrt(ratio))

    def worst(
        self, structure: _Structure, channels: Sequence[str]
    ) -> tuple[int, str, float, float, float]:
        """Mode and quantity that differ most from a fit to the others, its value there and here.

        The value there is what the others and the other quantities here let expect, and the
        difference is in errors of that (Baarda 1968): where errors are correlated, each quantity
        alone may be near that of the others.
        """
        values, rows = structure.seen(self)
        half = self.whitener @ rows @ structure.factor
        precision = self.whitener.T @ np.linalg.solve(
            np.eye(len(half)) + half @ half.T, self.whitener
        )
        alone = np.diag(precision)
        apart = precision @ (self.values - values) / np.sqrt(alone)
        row = int(np.argmax(np.abs(apart)))
        parts, names = ("real part", "imaginary part"), list[tuple[int, str]]()
        for mode, places in zip(self.modes, self.places, strict=True):
            shape = [f"{part} of the shape at {channels[k]}" for part in parts for k in places]
            names += [(mode, quantity) for quantity in ("frequency", "damping ratio", *shape)]
        value, error = float(self.values[row]), float(1.0 / np.sqrt(alone[row]))
        return (*names[row], value, value - error * float(apart[row]), float(apart[row]))
