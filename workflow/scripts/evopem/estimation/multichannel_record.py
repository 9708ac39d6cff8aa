"""The contents of ``model.json`` of a data set with several channels."""

from __future__ import annotations

import platform
from dataclasses import dataclass
from importlib.metadata import version
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from evopem.config.constraints import Constraints
from evopem.config.state_space_settings import StateSpaceSearchSettings
from evopem.estimation.polynomial_estimate import PolynomialEstimate
from evopem.estimation.search.problem import SearchDiagnostics
from evopem.estimation.state_space.local_estimates import StateSpaceEstimate
from evopem.estimation.state_space.noise_model import plant_of
from evopem.models.parameter_covariance import ParameterCovariance
from evopem.models.polynomial import PolynomialModel
from evopem.models.state_space import StateSpaceModel
from evopem.signals.multichannel_preparation import MultichannelTransforms
from evopem.version import __version__

Array = NDArray[np.float64]

_STRUCTURES = {
    "ss": "innovations",
    "ss_oe": "output error",
    "ss_oe_drift": "output error with drift",
    "ss_bj": "innovations next to Box-Jenkins",
}
_LIBRARIES = ("numpy", "scipy", "numba")


@dataclass(frozen=True)
class ConstrainedFit:
    """The constraints of a model, and what they cost.

    Attributes
    ----------
    settings : Constraints
    objective, objective_without : float
        With the constraints, and at the optimum without them, percent.
    active : tuple of str
        Equalities, and the inequalities at whose bound the model lies.
    """

    settings: Constraints
    objective: float
    objective_without: float
    active: tuple[str, ...]

    @classmethod
    def of(
        cls,
        estimate: StateSpaceEstimate | PolynomialEstimate,
        settings: Constraints | None,
    ) -> ConstrainedFit | None:
        """The record of an estimate; None without constraints."""
        if settings is None:
            return None
        effect = estimate.constraints
        if effect is None:
            return None
        return cls(settings, effect.objective, effect.objective_without, effect.active)


@dataclass(frozen=True, eq=False)
class MultichannelModelRecord:
    """A model of several channels, in state-space form, with everything that is known of it.

    ``x+ = A x + B u + K e, y = output_means + level + C x + D u + e``, with u less the means of the
    inputs and shifted by ``input_delays``.

    Attributes
    ----------
    A, B, C, D, K : arrays
    Ts : float
        Sampling period in s.
    level : (ny,) array
    level_of_simulation : {"constant", "state"}
        Level of other samples than those of the estimation: this one, or one that is fitted to them
        along with the initial state.
    noise_covariance : (ny, ny) array
        Of e.
    input_delays : tuple of int
        Samples, one for each input.
    structure, weighting : str
        The structure and the criterion by which the plant was estimated.
    plant_states : int
        Number of the first states, which the inputs drive.  Those that follow are a noise model
        that was estimated from the residuals of an output-error model.
    input_names, output_names, input_units, output_units : tuple of str
    covariance : ParameterCovariance, optional
        Of all entries of ``[A, B, C, D, K, level]``, row by row, in factored form.
    objective : float
        Of the plant's criterion, in percent of the power of the outputs.
    fit_percent : (ny,) array
        ``100 (1 - ||e|| / ||y - mean(y)||)`` of the plant's errors on the estimation samples.
    bic : float
    at_stability_bound : bool
        Whether an eigenvalue lies at the largest radius allowed.
    search : SearchDiagnostics
    settings : StateSpaceSearchSettings
    transforms : MultichannelTransforms
    polynomials : PolynomialModel, optional
        The polynomial model whose innovations form the matrices are.
    fit : ConstrainedFit, optional
        Its constraints.
    at_upper_ends : tuple of str
        Its orders at the upper end of a range of the configuration, such as "nb of hot".
    evopem : str
        Version of this package.
    versions : dict
        Versions of the libraries behind the numbers.
    """

    A: Array
    B: Array
    C: Array
    D: Array
    K: Array
    Ts: float
    level: Array
    level_of_simulation: Literal["constant", "state"]
    noise_covariance: Array
    input_delays: tuple[int, ...]
    structure: str
    weighting: str
    plant_states: int
    input_names: tuple[str, ...]
    output_names: tuple[str, ...]
    input_units: tuple[str, ...]
    output_units: tuple[str, ...]
    covariance: ParameterCovariance | None
    objective: float
    fit_percent: Array
    bic: float
    at_stability_bound: bool
    search: SearchDiagnostics
    settings: StateSpaceSearchSettings
    transforms: MultichannelTransforms
    evopem: str
    versions: dict[str, str]
    polynomials: PolynomialModel | None = None
    fit: ConstrainedFit | None = None
    at_upper_ends: tuple[str, ...] = ()

    @classmethod
    def of(
        cls,
        estimate: StateSpaceEstimate | PolynomialEstimate,
        model: StateSpaceModel,
        variant: tuple[str, str],
        units: tuple[tuple[str, ...], tuple[str, ...]],
        settings: StateSpaceSearchSettings,
        transforms: MultichannelTransforms,
        level: Literal["constant", "state"] = "constant",
        polynomials: PolynomialModel | None = None,
        constraints: Constraints | None = None,
        at_upper_ends: tuple[str, ...] = (),
    ) -> MultichannelModelRecord:
        """The record of an estimate, and of the model with its noise model."""
        return cls(
            **{name: getattr(model, name) for name in ("A", "B", "C", "D", "K", "level")},
            level_of_simulation=level,
            Ts=1.0 / model.sampling_rate,
            noise_covariance=model.noise_covariance,
            input_delays=model.input_delays or (0,) * model.inputs,
            structure=variant[0],
            weighting=variant[1],
            plant_states=estimate.plant_states,
            input_names=model.input_names,
            output_names=model.output_names,
            input_units=units[0],
            output_units=units[1],
            covariance=model.covariance,
            objective=estimate.objective,
            fit_percent=np.atleast_1d(estimate.fit_percent),
            bic=estimate.bic,
            at_stability_bound=estimate.at_stability_bound,
            search=estimate.search.diagnostics,
            settings=settings,
            transforms=transforms,
            evopem=__version__,
            versions={"python": platform.python_version()}
            | {library: version(library) for library in _LIBRARIES},
            polynomials=polynomials,
            fit=ConstrainedFit.of(estimate, constraints),
            at_upper_ends=at_upper_ends,
        )

    @property
    def sampling_rate(self) -> float:
        """Hz, of the prepared samples."""
        return self.transforms.sampling_rate

    @property
    def model(self) -> StateSpaceModel:
        """The model, for simulations and responses."""
        inputs = len(self.input_names)
        return StateSpaceModel(
            A=self.A,
            B=self.B.reshape(len(self.A), inputs),
            C=self.C,
            D=self.D.reshape(len(self.C), inputs),
            K=self.K,
            sampling_rate=self.sampling_rate,
            level=self.level,
            noise_covariance=self.noise_covariance,
            input_delays=self.input_delays if any(self.input_delays) else (),
            covariance=self.covariance,
            structure="ss" if np.any(self.K) else "ss_oe",
            input_names=self.input_names,
            output_names=self.output_names,
        )

    @property
    def plant(self) -> StateSpaceModel:
        """The model without a noise model that stands beside the plant."""
        return plant_of(self.model, self.plant_states)

    @property
    def text(self) -> str:
        """The model in a few words, such as "state space, 8 states (output error)"."""
        if self.polynomials is not None:
            return str(self.polynomials.orders)
        noise = len(self.A) - self.plant_states
        form = _STRUCTURES[self.structure]
        states = f"{self.plant_states} state{'s' * (self.plant_states != 1)}"
        return f"state space, {states} ({form}{f', noise model of {noise}' if noise else ''})"
