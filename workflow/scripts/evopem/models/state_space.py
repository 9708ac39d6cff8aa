"""The state-space model in innovations form, several inputs and outputs, as plain data."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Literal, Self

import numpy as np
import scipy  # whose parts load on first use
from numpy.typing import ArrayLike

from evopem.arrays import Array, Complex, columns
from evopem.config.settings import Hold
from evopem.models.continuous import ContinuousModel, continuous_of
from evopem.models.modes import Mode, state_space_modes
from evopem.models.parameter_covariance import ParameterCovariance
from evopem.models.polynomial_roots import on_circle
from evopem.models.states import delayed, fitted, levels_moved, powers_times, probable, states_of

StateSpaceStructure = Literal["ss", "ss_oe", "ss_oe_drift", "ss_bj"]
PlainStructure = Literal["ss", "ss_oe"]  # innovations form with K, and output-error form without


@dataclass(frozen=True, eq=False)
class StateSpaceModel:
    """``x+ = A x + B u + K e, y = level + C x + D u + e`` (Ljung 1999, eq. 4.91).

    Attributes
    ----------
    A : (n, n) array
    B : (n, nu) array
        nu = 0 for a model without input.
    C : (ny, n) array
    D : (ny, nu) array
    K : (n, ny) array
        Zero for an output-error model.
    sampling_rate : float
        Hz.
    level : (ny,) array
        Mean of the outputs without input and noise, in their units.
    noise_covariance : (ny, ny) array
        Covariance of the innovations e.
    input_delays : tuple of int
        Samples by which each input is shifted before B and D, nu entries; none by default.
    covariance : ParameterCovariance, optional
        Of all entries of ``[A, B, C, D, K, level]``, row by row.  It has the rank of what the
        data determine; what does not depend on the choice of states has its correct variance.
    structure : {"ss", "ss_oe"}
    input_names, output_names : tuple of str
        Empty where the channels have no names.
    """

    A: Array
    B: Array
    C: Array
    D: Array
    K: Array
    sampling_rate: float
    level: Array
    noise_covariance: Array
    input_delays: tuple[int, ...] = ()
    covariance: ParameterCovariance | None = None
    structure: PlainStructure = "ss"
    input_names: tuple[str, ...] = ()
    output_names: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        n, ny = len(self.A), len(self.C)
        nu = self.B.shape[1] if self.B.ndim == 2 else -1
        shapes = ((n, n), (n, nu), (ny, n), (ny, nu), (n, ny), (ny,), (ny, ny))
        names = ("A", "B", "C", "D", "K", "level", "noise_covariance")
        for name, shape in zip(names, shapes, strict=True):
            if getattr(self, name).shape != shape:
                raise ValueError(f"{name} must be {shape}, not {getattr(self, name).shape}")
        if self.input_delays and len(self.input_delays) != nu:
            raise ValueError(f"{nu} inputs need {nu} delays, not {len(self.input_delays)}")
        for named, count in ((self.input_names, nu), (self.output_names, ny)):
            if named and len(named) != count:
                raise ValueError(f"{count} channels need {count} names, not {len(named)}")

    @property
    def order(self) -> int:
        """Number of states n."""
        return len(self.A)

    @property
    def inputs(self) -> int:
        """Number of inputs nu."""
        return self.B.shape[1]

    @property
    def delays(self) -> tuple[int, ...]:
        """Samples that each input is delayed, 0 where none was stated."""
        return self.input_delays or (0,) * self.inputs

    @property
    def outputs(self) -> int:
        """Number of outputs ny."""
        return len(self.C)

    @property
    def _parts(self) -> tuple[Array, ...]:
        return self.A, self.B, self.C, self.D, self.K, self.level

    @property
    def parameters(self) -> Array:
        """All entries of ``[A, B, C, D, K, level]``, row by row."""
        return np.concatenate([part.ravel() for part in self._parts])

    @cached_property
    def predictor(self) -> Array:
        """``A - K C``, the dynamics of the one-step predictor, (n, n)."""
        return self.A - self.K @ self.C

    def with_parameters(self, parameters: Array) -> Self:
        """The model with other entries of ``[A, B, C, D, K, level]``."""
        ends = np.cumsum([part.size for part in self._parts])[:-1]
        A, B, C, D, K, level = (
            values.reshape(part.shape)
            for values, part in zip(np.split(parameters, ends), self._parts, strict=True)
        )
        return replace(self, A=A, B=B, C=C, D=D, K=K, level=level)

    def scaled(self, of_inputs: Array, of_outputs: Array) -> Self:
        """The model of signals so many times as large, (nu,) and (ny,); without covariance."""
        return replace(
            self,
            B=self.B / of_inputs,
            C=self.C * of_outputs[:, None],
            D=self.D * of_outputs[:, None] / of_inputs,
            K=self.K / of_outputs,
            level=self.level * of_outputs,
            noise_covariance=self.noise_covariance * np.outer(of_outputs, of_outputs),
            covariance=None,
        )

    def poles(self) -> Complex:
        """Eigenvalues of A in the z plane, (n,)."""
        return np.asarray(np.linalg.eigvals(self.A), dtype=complex)

    def noise_zeros(self) -> Complex:
        """Eigenvalues of ``A - K C``, the zeros of the noise filter, (n,)."""
        return np.asarray(np.linalg.eigvals(self.predictor), dtype=complex)

    def simulate(self, inputs: ArrayLike, initial: ArrayLike | None = None) -> Array:
        """Noise-free response to (N, nu) inputs, (N, ny), that never sees a measured output.

        ``inputs`` are ``numpy.empty((N, 0))`` for a model without input; ``initial``, (n,), is the
        state at the first sample, at rest by default.
        """
        u = self._delayed(inputs)
        states = states_of(self.A, u @ self.B.T, initial)
        return np.asarray(states @ self.C.T + u @ self.D.T + self.level)

    def residuals(
        self, inputs: ArrayLike, outputs: ArrayLike, initial: ArrayLike | None = None
    ) -> Array:
        """One-step prediction errors e of (N, nu) inputs and (N, ny) outputs, (N, ny).

        ``initial``, (n,): state at the first sample, such as :meth:`prediction_state`.
        """
        u, y = self._signals(inputs, outputs)
        drive = u @ (self.B - self.K @ self.D).T + (y - self.level) @ self.K.T
        states = states_of(self.predictor, drive, initial)
        return np.asarray(y - self.level - states @ self.C.T - u @ self.D.T)

    def predict(
        self,
        inputs: ArrayLike,
        outputs: ArrayLike,
        horizon: int = 1,
        initial: ArrayLike | None = None,
    ) -> Array:
        """Prediction from inputs, and from outputs ``horizon`` samples ago, (N, ny).

        ``y_t`` less the innovations of the last ``horizon`` samples, 1 at least, through the noise
        filter (Ljung 1999, eq. 3.29); the first rest on the initial state of :meth:`residuals`.
        """
        if horizon < 1:
            raise ValueError(f"horizon must be at least 1 sample, not {horizon}")
        return self.predict_with(outputs, self.residuals(inputs, outputs, initial), horizon)

    def predict_with(self, outputs: ArrayLike, errors: Array, horizon: int) -> Array:
        """The same from known errors of the prediction one sample ahead, (N, ny)."""
        predicted = columns(outputs, self.outputs, "outputs") - errors
        response, responses = self.C, []
        for _ in range(1, min(horizon, len(errors))):
            responses.append(response @ self.K)
            response = response @ self.A
        for k, of_output in enumerate(np.stack(responses, axis=1) if responses else ()):
            passed = scipy.signal.oaconvolve(errors[:-1], of_output, axes=0)[: len(errors) - 1]
            predicted[1:, k] -= passed.sum(axis=1)
        return predicted

    def prediction_state(self, inputs: ArrayLike, outputs: ArrayLike) -> Array:
        """Initial state with which the one-step prediction fits outputs best, (n,).

        Least squares, each output relative to its noise; (N, nu) inputs and (N, ny) outputs.  On
        the samples of a delay act inputs that are not known.
        """
        errors = self.residuals(inputs, outputs)
        return self._fitted(self.free_responses(self.predictor, len(errors)), errors)

    def _fitted(self, columns: Array, errors: Array) -> Array:
        spread = np.sqrt(np.abs(np.diag(self.noise_covariance)))
        return fitted(columns, errors, spread, unknown=max(self.input_delays, default=0))

    def with_fitted_level(self, inputs: ArrayLike, outputs: ArrayLike) -> tuple[Self, Array]:
        """The model with the level, and the initial state, whose prediction errors are smallest."""
        model = replace(self, level=np.zeros(self.outputs))
        errors, nothing = model.residuals(inputs, outputs), np.zeros_like(inputs, dtype=float)
        ones = np.eye(self.outputs)[:, None].repeat(len(errors), axis=1)
        levels = np.stack([model.residuals(nothing, unit) for unit in ones], axis=2)
        columns = np.concatenate([levels, self.free_responses(self.predictor, len(errors))], 2)
        level, state = np.split(self._fitted(columns, errors), [self.outputs])
        return replace(self, level=level), state

    def simulate_from_fitted_state(
        self,
        inputs: ArrayLike,
        outputs: ArrayLike,
        fit_level: bool = False,
        known: int | None = None,
    ) -> Array:
        """Simulation, (N, ny), from the initial state with which it fits the outputs best.

        Least squares, each output relative to its spread; with ``fit_level`` of a constant as well.

        With ``known`` from the initial state that so many first outputs make most probable: of
        normal states with the second moments of a simulation from rest, in noise of the size that
        the least-squares state leaves over them.  A state that they hardly determine stays small,
        and the model's level where they do not say that it has moved (:func:`.levels_moved`).
        """
        return self.simulations(inputs, outputs, (fit_level,), False, known)[0]

    def simulations(
        self, u: ArrayLike, y: ArrayLike, levels: Sequence[bool], robust: bool, known: int | None
    ) -> list[Array]:
        """:meth:`simulate_from_fitted_state` of each level; ``robust``: of absolute errors."""
        form = self.without_delays()
        u, y = form._signals(u, y)
        with np.errstate(all="ignore"):
            driven = states_of(form.A, u @ form.B.T, None)
            rest = driven @ form.C.T + u @ form.D.T + form.level
            free = form.free_responses(form.A, len(y), True)
            power = driven.T @ driven / len(driven)
        if not all(np.isfinite(part).all() for part in (rest, free, power)):
            return [np.full(y.shape, np.inf)] * len(levels)
        alone, given = free[:, :, : form.order], ((y - rest)[:known], np.std(y[:known], axis=0))
        if known is None:
            columns = (free if fit_level else alone for fit_level in levels)
            return [rest + c @ fitted(c, *given, robust) for c in columns]
        powers, directions = np.linalg.eigh(power)
        root = directions * np.sqrt(np.maximum(powers, 0.0))
        same = rest + alone @ probable(alone[:known], *given, robust, root)
        if not any(levels):
            return [same] * len(levels)
        moved = rest + free @ probable(free[:known], *given, robust, root)
        is_moved = levels_moved((y - same)[:known], (y - moved)[:known], given[1], robust)
        return [moved if fit_level and is_moved else same for fit_level in levels]

    def frequency_response(self, frequencies: ArrayLike) -> Complex:
        """``G = C (zI - A)^-1 B + D`` with its delays at frequencies in Hz, (..., ny, nu)."""
        z = on_circle(frequencies, self.sampling_rate)
        shift = z[..., None, None] ** -np.asarray(self.delays, dtype=float)
        return (self.resolvent(z, self.B) + self.D) * shift

    def noise_response(self, frequencies: ArrayLike) -> Complex:
        """``H = C (zI - A)^-1 K + I`` at frequencies in Hz, (..., ny, ny)."""
        z = on_circle(frequencies, self.sampling_rate)
        return self.resolvent(z, self.K) + np.eye(self.outputs)

    def impulse_response(self, samples: int) -> Array:
        """Responses to unit impulses at sample 0, (samples, ny, nu)."""
        impulses = np.zeros((self.inputs, samples, self.inputs))
        impulses[:, :1] = np.eye(self.inputs)[:, None]
        responses = [self.simulate(impulse) - self.level for impulse in impulses]
        return np.stack(responses, axis=2) if responses else np.zeros((samples, self.outputs, 0))

    def noise_impulse_response(self, samples: int) -> Array:
        """Responses of the outputs to unit innovations at sample 0, (samples, ny, ny)."""
        states = powers_times(self.A, self.K, max(samples - 1, 1))
        return np.concatenate([np.eye(self.outputs)[None], self.C @ states])[:samples]

    def step_response(self, samples: int) -> Array:
        """Responses to unit steps at sample 0, (samples, ny, nu)."""
        return np.cumsum(self.impulse_response(samples), axis=0)

    def modes(self) -> list[Mode]:
        """Oscillating modes with complex shapes and standard errors, by frequency."""
        return state_space_modes(
            self.A, self.B, self.C, self.K, self.sampling_rate, self.covariance
        )

    def without_delays(self) -> Self:
        """The same plant with delays as further states; without covariance."""
        delays = self.delays
        if not any(delays) and self.covariance is None:
            return self
        n, extra = self.order, sum(delays)
        A = np.zeros((n + extra, n + extra))
        B = np.zeros((n + extra, self.inputs))
        C = np.zeros((self.outputs, n + extra))
        D = self.D.copy()
        A[:n, :n], C[:, :n] = self.A, self.C
        first = n
        for column, delay in enumerate(delays):
            if delay == 0:
                B[:n, column] = self.B[:, column]
                continue
            # A line of states holds the input of the last samples, the oldest one last.
            last = first + delay - 1
            B[first, column] = 1.0
            A[first + 1 : last + 1, first:last] = np.eye(delay - 1)
            A[:n, last], C[:, last], D[:, column] = self.B[:, column], self.D[:, column], 0.0
            first = last + 1
        K = np.vstack([self.K, np.zeros((extra, self.outputs))])
        return replace(self, A=A, B=B, C=C, D=D, K=K, input_delays=(), covariance=None)

    def to_continuous(
        self, hold: Hold = "zero-order", later: Sequence[int] = ()
    ) -> ContinuousModel:
        """The plant in s, its input held between samples, with its covariance; or InputError.

        ``later``: samples by which the inputs act later, besides their delays.
        """
        parts = self.A, self.B, self.C, self.D
        (A, B, C, D), covariance = continuous_of(parts, self.covariance, self.sampling_rate, hold)
        delays = 1.0 / self.sampling_rate * np.add(later or 0, self.delays)
        about = hold, self.sampling_rate, covariance, self.input_names, self.output_names
        return ContinuousModel(A, B, C, D, self.level, delays, *about)

    def to_control(self):  # type: ignore[no-untyped-def]
        """``G`` as a discrete-time ``control.StateSpace``; needs python-control."""
        import control

        m = self.without_delays()
        return control.StateSpace(m.A, m.B, m.C, m.D, 1.0 / self.sampling_rate)

    def to_scipy(self):  # type: ignore[no-untyped-def]
        """``G`` as a discrete-time ``scipy.signal.StateSpace``."""
        m = self.without_delays()
        return scipy.signal.StateSpace(m.A, m.B, m.C, m.D, dt=1.0 / self.sampling_rate)

    def matlab_arguments(self) -> dict[str, ArrayLike]:
        """Arguments of MATLAB's ``idss(A,B,C,D,K,'Ts',Ts,'NoiseVariance',L,'InputDelay',d)``.

        ``Level``, which ``idss`` does not have, stands beside them.
        """
        matrices = {"A": self.A, "B": self.B, "C": self.C, "D": self.D, "K": self.K}
        return matrices | {
            "Ts": np.array(1.0 / self.sampling_rate),
            "NoiseVariance": self.noise_covariance,
            "InputDelay": np.asarray(self.delays, dtype=float)[:, None],
            "Level": self.level[:, None],
        }

    def _delayed(self, inputs: ArrayLike) -> Array:
        """Inputs, (N, nu), or (N,) of one, shifted by their delays; zero before the record."""
        return delayed(columns(inputs, self.inputs, "inputs"), self.delays)

    def _signals(self, inputs: ArrayLike, outputs: ArrayLike) -> tuple[Array, Array]:
        u, y = self._delayed(inputs), columns(outputs, self.outputs, "outputs")
        if len(u) != len(y):
            raise ValueError(f"inputs have {len(u)} samples, outputs have {len(y)}")
        return u, y

    def free_responses(self, dynamics: Array, samples: int, fit_level: bool = False) -> Array:
        """Outputs after an initial state of one at each state, and levels of one, (N, ny, ...)."""
        nothing = np.zeros((samples, self.order))
        parts = [np.stack([states_of(dynamics.T, nothing, row) for row in self.C], axis=1)]
        parts += [np.tile(np.eye(self.outputs), (samples, 1, 1))] if fit_level else []
        return np.concatenate(parts, axis=2)

    def resolvent(self, z: Complex, right: Array) -> Complex:
        """``C (zI - A)^-1 right``, (..., ny, columns); NaN at a pole."""
        return np.asarray(self.C @ self.state_response(z, right), dtype=complex)

    def state_response(self, z: Complex, right: Array) -> Complex:
        """``(zI - A)^-1 right``, (..., n, columns); NaN at a pole."""
        matrices = z[..., None, None] * np.eye(self.order) - self.A
        matrices[np.linalg.det(matrices) == 0.0] = np.nan
        solved = np.linalg.solve(matrices, np.broadcast_to(right, (*z.shape, *right.shape)))
        return np.asarray(solved, dtype=complex)
