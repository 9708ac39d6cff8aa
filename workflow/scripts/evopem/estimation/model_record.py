"""The contents of ``model.json``: the model, its criteria, and how it was found."""

from __future__ import annotations

import platform
import re
from dataclasses import dataclass
from functools import cache
from importlib.metadata import version
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal, Self

import numpy as np

from evopem.arrays import Array, Complex
from evopem.config.constraints import Constraints
from evopem.config.settings import Focus, ScoringWindow, SearchSettings
from evopem.config.structures import OF_SIMULATION, STRUCTURES
from evopem.errors import InputError, checked_path
from evopem.estimation.polynomial_estimate import PolynomialEstimate
from evopem.estimation.search.problem import SearchDiagnostics
from evopem.estimation.state_space.local_estimates import StateSpaceEstimate
from evopem.files.job import check_result
from evopem.files.json_form import load
from evopem.models.continuous import ContinuousRecord
from evopem.models.conversions import plant_of
from evopem.models.modes import Mode
from evopem.models.orders import Orders
from evopem.models.polynomial import Model, PolynomialModel, state_space_of
from evopem.models.response_tables import Rival
from evopem.models.state_space import StateSpaceModel
from evopem.signals.prepared_data import Transforms
from evopem.signals.recording import Recording
from evopem.version import __version__

if TYPE_CHECKING:
    from evopem.signals.readers.frequency_responses import FrequencyResponses

Estimate = PolynomialEstimate | StateSpaceEstimate

LevelOfSimulation = Literal["constant", "state", "none"]

FORMS = {
    "ss": "innovations",
    "ss_oe": "output error",
    "ss_oe_drift": "output error with drift",
    "ss_bj": "innovations next to Box-Jenkins",
}
_REMEDY = "give the model.json of a results folder"
_LIBRARIES, _installed = ("numpy", "scipy", "numba"), cache(version)
_FARTHEST = 10_000  # polynomials that reach back so many samples are none that anybody estimates


@dataclass(frozen=True)
class SearchRecord:
    """Settings and diagnostics of the search that found a model."""

    settings: SearchSettings
    diagnostics: SearchDiagnostics
    at_stability_bound: bool  # a root of A, C, D or F, or an eigenvalue, at the largest radius


@dataclass(frozen=True)
class FitRecord:
    """What a model was fitted for, and what its constraints cost."""

    focus: Focus  # errors of one step, of simulation, or of predictions that many samples ahead
    constraints: Constraints | None
    objective: float  # objective of the errors in focus, percent, priors not included
    objective_without: float | None  # the same at the optimum without the constraints
    # Equalities, priors, and the inequalities at whose bound the model lies
    active: tuple[str, ...]

    @classmethod
    def of(
        cls, estimate: Estimate, focus: Focus = "prediction", constraints: Constraints | None = None
    ) -> Self | None:
        """The record of an estimate; None without focus and constraints."""
        effect = estimate.constraints
        if focus == "prediction" and (constraints is None or effect is None):
            return None
        if effect is None:
            in_focus = estimate.focus_objective
            return cls(focus, constraints, np.nan if in_focus is None else in_focus, None, ())
        return cls(focus, constraints, effect.objective, effect.objective_without, effect.active)


@dataclass(frozen=True, eq=False)
class ModelRecord:
    """A model with everything that is known of it."""

    # A structure of polynomials, such as ``armax``, or the form of a state-space model: ``ss``,
    # ``ss_oe``, ``ss_oe_drift`` or ``ss_bj``
    structure: str
    orders: Orders | None  # of polynomials
    model: Model  # with the covariance of its coefficients or entries
    # Number of the first states, in state space, which the inputs drive; the others are of noise
    plant_states: int
    weighting: str  # of the outputs in the criterion of a state-space model
    # Level of other samples than those of the estimation: that of the model, one that is fitted to
    # them along with the initial state, or none
    level_of_simulation: LevelOfSimulation
    input_names: tuple[str, ...]
    output_names: tuple[str, ...]
    input_units: tuple[str, ...]
    output_units: tuple[str, ...]
    objective: float  # percent of the power, or of the mean absolute value, of the outputs
    # ``100 (1 - ||e|| / ||y - mean(y)||)`` of one step on the estimation samples, of each output
    fit_percent: tuple[float, ...]
    bic: float
    # The estimation samples that count; all of them for a state-space model
    window: ScoringWindow | None
    # (n,) What the past adds to the first equations, estimated along with the model
    initial_states: Array
    # modes, noise_modes: of the plant, and of the noise filter of polynomials
    modes: tuple[Mode, ...]
    noise_modes: tuple[Mode, ...]
    # poles, noise_poles, noise_zeros: of plant and noise filter in the z plane
    poles: Complex
    zeros: tuple[Complex, ...]  # from each input of polynomials, delay aside
    noise_poles: Complex
    noise_zeros: Complex
    # (n,) Of ``[a_1.., b_0.., c_1.., d_1.., f_1..]``, b and f of one input after the other
    parameter_standard_errors: Array | None
    search: SearchRecord
    transforms: Transforms
    fit: FitRecord | None  # where the model was fitted with a focus or constraints
    # Orders at the upper end of a range of the configuration, such as "nb of hot"
    at_upper_ends: tuple[str, ...]
    evopem: str  # version of this package
    versions: dict[str, str]  # versions of the libraries behind the numbers
    continuous: ContinuousRecord | None = None  # the plant in s, where it was asked for
    rival: Rival | None = None  # of the automatic recipe

    @classmethod
    def of(
        cls,
        estimate: Estimate,
        estimation: Recording | FrequencyResponses,
        settings: SearchSettings,
        transforms: Transforms,
        level: LevelOfSimulation = "none",
        *,
        model: Model | None = None,
        structure: str = "",
        weighting: str = "",
        focus: Focus = "prediction",
        constraints: Constraints | None = None,
        at_upper_ends: tuple[str, ...] = (),
    ) -> Self:
        """The record of an estimate from ``estimation`` samples; ``level`` of other samples.

        ``model``: with its noise model; ``structure``, ``weighting``: of one in state space.
        """
        return cls(
            **derived_from(model or estimate.model, estimate.plant_states),
            structure=structure or estimate.model.structure,
            weighting=weighting,
            level_of_simulation=level,
            input_names=estimation.input_names[: estimate.model.inputs],
            output_names=estimation.output_names,
            input_units=estimation.input_units[: estimate.model.inputs],
            output_units=estimation.output_units,
            objective=estimate.objective,
            fit_percent=tuple(np.atleast_1d(estimate.fit_percent).tolist()),
            bic=estimate.bic,
            window=estimate.window if isinstance(estimate, PolynomialEstimate) else None,
            initial_states=np.concatenate([estimate.plant_state, estimate.noise_state])
            if isinstance(estimate, PolynomialEstimate)
            else estimate.initial_states.ravel(),
            search=SearchRecord(settings, estimate.search.diagnostics, estimate.at_stability_bound),
            transforms=transforms,
            fit=FitRecord.of(estimate, focus, constraints),
            at_upper_ends=at_upper_ends,
            evopem=__version__,
            versions={"python": platform.python_version()}
            | {library: _installed(library) for library in _LIBRARIES},
        )

    @property
    def polynomials(self) -> PolynomialModel:
        """The model, of a structure of polynomials; ValueError in state space."""
        if not isinstance(self.model, PolynomialModel):
            raise ValueError(f"{self.text} has no polynomials")
        return self.model

    @property
    def sampling_rate(self) -> float:
        """Hz, of the prepared samples."""
        return self.model.sampling_rate

    @property
    def has_input(self) -> bool:
        """Whether the model has an input."""
        return self.model.inputs > 0

    @property
    def delays(self) -> tuple[int, ...]:
        """Samples until each input acts, nk."""
        if self.orders is not None:
            return self.orders.nk
        plant = self.plant
        return tuple(d + (not np.any(plant.D[:, k])) for k, d in enumerate(plant.delays))

    @property
    def has_noise_model(self) -> bool:
        """Whether the model claims anything of the noise."""
        if isinstance(self.model, PolynomialModel):
            return self.structure not in OF_SIMULATION
        return bool(np.any(self.model.K))

    @property
    def state_space(self) -> StateSpaceModel:
        """The model in state space, states of the plant first."""
        return state_space_of(self.model)

    @property
    def plant(self) -> StateSpaceModel:
        """The plant in state space, without states of the noise alone."""
        return plant_of(self.state_space, self.plant_states)

    @property
    def text(self) -> str:
        """The model in a few words, such as "state space, 8 states (output error)"."""
        if self.orders is not None:
            return str(self.orders)
        noise = self.state_space.order - self.plant_states
        states = f"{self.plant_states} state{'s' * (self.plant_states != 1)}"
        beside = f", noise model of {noise}" if noise else ""
        return f"state space, {states} ({FORMS[self.structure]}{beside})"

    @property
    def may_be_unstable(self) -> bool:
        """Whether constraints let poles lie on or outside the unit circle."""
        constraints = self.fit.constraints if self.fit else None
        return constraints is not None and (
            constraints.stability == "free" or bool(constraints.fixed_poles)
        )


def derived_from(model: Model, plant_states: int) -> dict[str, Any]:
    """The model of a record with what follows from it."""
    return _lists_of(model, plant_states) | {
        "model": model,
        "plant_states": plant_states,
        "orders": model.orders if isinstance(model, PolynomialModel) else None,
        "modes": tuple(_plant(model, plant_states).modes()),
        "noise_modes": tuple(model.noise_modes() if isinstance(model, PolynomialModel) else ()),
    }


def _plant(model: Model, states: int) -> Model:
    """The model without the noise beside its plant, in state space its first states."""
    return model if isinstance(model, PolynomialModel) else plant_of(model, states)


def _lists_of(model: Model, plant_states: int) -> dict[str, Any]:
    """Roots, and the standard errors of coefficients: what costs little beside the modes."""
    listed = {"poles": _plant(model, plant_states).poles(), "noise_zeros": model.noise_zeros()}
    if isinstance(model, PolynomialModel):
        return listed | {
            "zeros": tuple(model.zeros(place) for place in range(model.inputs)),
            "noise_poles": model.noise_poles(),
            "parameter_standard_errors": model.parameter_standard_errors(),
        }
    return listed | {"zeros": (), "noise_poles": model.poles(), "parameter_standard_errors": None}


def _check(record: ModelRecord) -> None:
    """Raise ValueError for numbers that are no model of the orders."""
    model, orders = record.model, record.orders
    if _release(record.evopem) > _release(__version__):
        raise ValueError(f"it is of evopem {record.evopem}, later than this {__version__}")
    if isinstance(model, PolynomialModel):
        if record.structure not in STRUCTURES or model.structure != record.structure:
            raise ValueError(f"the structure {record.structure} is not that of the model")
        if model.orders != orders:
            raise ValueError(f"the polynomials are those of {model.orders}, not of {orders}")
    elif record.structure not in FORMS:
        raise ValueError(f"the structure {record.structure} is not known")
    elif not 0 <= record.plant_states <= model.order:
        raise ValueError(f"{record.plant_states} of {model.order} states are of the plant")
    if not np.isfinite(_check_model(model, record.transforms.estimation_samples)).all():
        raise ValueError("a variance is not finite")
    _check_lengths(record)


def _check_model(model: Model, samples: int) -> Array:
    """Raise ValueError for numbers that are no model of ``samples``; returns the variances."""
    if not 0.0 < model.sampling_rate < np.inf:
        raise ValueError(f"the sampling rate is {model.sampling_rate} Hz")
    if not np.isfinite(np.r_[model.parameters, model.level]).all():
        raise ValueError("a coefficient or level is not finite")
    more = 0
    if isinstance(model, PolynomialModel):
        if any(polynomial[0] != 1.0 for polynomial in (model.A, model.C, model.D, *model.F)):
            raise ValueError("A, C, D or F does not begin with 1")
        reach, samples, more = model.orders.first_residual, min(samples, _FARTHEST), 1
        if reach >= samples:
            raise ValueError(f"{model.orders} reaches back {reach} of {samples} samples")
        variance = np.atleast_2d(model.noise_variance)
    else:
        variance, delays = model.noise_covariance, model.input_delays
        if delays and not 0 <= min(delays) <= max(delays) < samples:
            raise ValueError(f"a delay of {delays} is none of {samples} samples")
    if np.diag(variance).min() < 0.0:
        raise ValueError("a variance is negative")
    if model.covariance is not None:
        rows = {len(model.covariance.factor), len(model.covariance.null_space)}
        if len(rows) > 1 or not 0 <= min(rows) - model.parameters.size <= more:
            raise ValueError("the covariance is not one of the coefficients")
    return variance


def _check_lengths(record: ModelRecord) -> None:
    """Raise ValueError where a list has not one entry for each channel, root or coefficient."""
    model = record.model
    expected = {f"input_{property_name}": model.inputs for property_name in ("names", "units")}
    expected |= dict.fromkeys(("output_names", "output_units", "fit_percent"), model.outputs)
    for name, values in _lists_of(model, record.plant_states).items():
        expected[name] = 0 if values is None else len(values)
    for name, count in expected.items():
        value = getattr(record, name)
        if (0 if value is None else len(value)) != count:
            raise ValueError(f"{name} has not {count} entries")


def _release(text: str) -> tuple[int, ...]:
    """The numbers that a version begins with."""
    numbers = re.match(r"\d+(\.\d+)*", text)
    if numbers is None:
        raise ValueError(f"{text!r} is no version of evopem")
    return tuple(map(int, numbers.group().split(".")))


def load_record(path: str | Path) -> ModelRecord:
    """Read a ``model.json`` and verify that its numbers are a model; or InputError."""
    record = load(ModelRecord, path)
    try:
        _check(record)
    except (ValueError, TypeError, IndexError) as error:
        raise InputError(str(path), str(error), _REMEDY) from None
    return record


def load_model(path: str | Path) -> Model:
    """Read the model of a ``model.json``, or a polynomial model that :func:`.json_form.save` wrote.

    Raises
    ------
    InputError
        When the file is missing, is not a model of evopem, or is a result that was changed.

    Examples
    --------
    >>> from tempfile import TemporaryDirectory
    >>> import evopem
    >>> from evopem.files.json_form import save
    >>> with TemporaryDirectory() as folder:
    ...     save(evopem.PolynomialModel([1.0, -0.5], [2.0], nk=1), f"{folder}/model.json")
    ...     model = evopem.load(f"{folder}/model.json")
    >>> model.A
    array([ 1. , -0.5])
    """
    result = read_model(checked_path("load", path))
    return result.model if isinstance(result, ModelRecord) else result


def read_model(path: Path) -> ModelRecord | PolynomialModel:
    """Read a file as :func:`load_model` does, with all that it holds."""
    check_result(path)
    try:
        return load_record(path)
    except InputError as error:
        # Another form of file: only what is no model of any form is refused.
        try:
            model = load(PolynomialModel, path)
        except InputError:
            raise InputError(error.source, error.problem, _REMEDY) from None
    try:
        _check_model(model, _FARTHEST)
    except (ValueError, TypeError, IndexError) as error:
        raise InputError(str(path), str(error), _REMEDY) from None
    return model
