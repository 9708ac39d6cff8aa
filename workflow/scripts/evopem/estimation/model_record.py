"""The contents of ``model.json``: the model, its criteria, and how it was found."""

from __future__ import annotations

import platform
from contextlib import suppress
from dataclasses import dataclass
from importlib.metadata import version
from pathlib import Path
from typing import TYPE_CHECKING, Literal

import numpy as np
from numpy.typing import NDArray

from evopem.config.settings import FitSettings, ScoringWindow, SearchSettings
from evopem.errors import InputError
from evopem.estimation.criteria import Criteria
from evopem.estimation.search.problem import SearchDiagnostics
from evopem.files.json_form import load
from evopem.files.unfinished import check_result
from evopem.models.modes import Mode
from evopem.models.parameter_covariance import ParameterCovariance
from evopem.models.polynomial import PolynomialModel
from evopem.models.structures import Orders
from evopem.signals.preparation import Transforms
from evopem.version import __version__

if TYPE_CHECKING:
    from evopem.estimation.polynomial_estimate import PolynomialEstimate
    from evopem.models.state_space import StateSpaceModel

Array = NDArray[np.float64]
Roots = NDArray[np.complex128]

LevelOfSimulation = Literal["constant", "state", "none"]

_LIBRARIES = ("numpy", "scipy", "numba")


@dataclass(frozen=True)
class SearchRecord:
    """Settings and diagnostics of the search that found a model.

    Attributes
    ----------
    settings : SearchSettings
    diagnostics : SearchDiagnostics
    at_stability_bound : bool
        Whether a root of A, C, D or F lies at the largest radius allowed.
    """

    settings: SearchSettings
    diagnostics: SearchDiagnostics
    at_stability_bound: bool


@dataclass(frozen=True)
class FitRecord:
    """What a model was fitted for, and what its constraints cost.

    Attributes
    ----------
    settings : FitSettings
        Focus and constraints.
    objective : float
        Objective of the errors in focus, percent, priors not included.
    objective_without : float, optional
        The same at the optimum without the constraints.
    active : tuple of str
        Equalities, priors, and the inequalities at whose bound the model lies.
    """

    settings: FitSettings
    objective: float
    objective_without: float | None
    active: tuple[str, ...]

    @classmethod
    def of(cls, estimate: PolynomialEstimate, settings: FitSettings) -> FitRecord:
        """The record of an estimate."""
        effect = estimate.constraints
        return cls(
            settings,
            estimate.focus_objective,
            effect.objective_without if effect else None,
            effect.active if effect else (),
        )


@dataclass(frozen=True, eq=False)
class ModelRecord:
    """A model with everything that is known of it.

    Attributes
    ----------
    orders : Orders
    a, b, c, d, f : array
        Coefficients, all but ``b`` with their leading 1, ``b`` from lag nk on.
    level : float
        Constant of the equation; 0 where none was estimated.
    level_of_simulation : {"constant", "state", "none"}
        Level of other samples than those of the estimation: that of the equation, one that is
        fitted to them along with the initial state, or none.
    sampling_rate : float
        Hz.
    noise_variance : float
    covariance : (n, n) array, optional
        Of ``[a_1.., b_0.., c_1.., d_1.., f_1..]``; NaN for parameters that the data do not
        determine.
    covariance_factor : ParameterCovariance, optional
        The same in factored form, from which all standard errors are computed.
    parameter_standard_errors : (n,) array, optional
    modes : tuple of Mode
        Of the plant; of the noise filter for a model without input.
    noise_modes : tuple of Mode
        Of the noise filter.
    poles, zeros, noise_poles, noise_zeros : complex array
        Of the plant and of the noise filter in the z plane.
    criteria : Criteria
    plant_state : (nf,) array
    noise_state : (max(nc, nd),) array
    window : ScoringWindow
    search : SearchRecord
    transforms : Transforms
    evopem : str
        Version of this package.
    versions : dict
        Versions of the libraries behind the numbers.
    fit : FitRecord, optional
        Where the model was fitted with a focus or constraints.
    """

    orders: Orders
    a: Array
    b: Array
    c: Array
    d: Array
    f: Array
    level: float
    level_of_simulation: LevelOfSimulation
    sampling_rate: float
    noise_variance: float
    covariance: Array | None
    covariance_factor: ParameterCovariance | None
    parameter_standard_errors: Array | None
    modes: tuple[Mode, ...]
    noise_modes: tuple[Mode, ...]
    poles: Roots
    zeros: Roots
    noise_poles: Roots
    noise_zeros: Roots
    criteria: Criteria
    plant_state: Array
    noise_state: Array
    window: ScoringWindow
    search: SearchRecord
    transforms: Transforms
    evopem: str
    versions: dict[str, str]
    fit: FitRecord | None = None

    @classmethod
    def of(
        cls,
        estimate: PolynomialEstimate,
        settings: SearchSettings,
        transforms: Transforms,
        level: LevelOfSimulation = "none",
        fit: FitSettings | None = None,
    ) -> ModelRecord:
        """The record of an estimate."""
        model = estimate.model
        return cls(
            orders=model.orders,
            a=model.a,
            b=model.b,
            c=model.c,
            d=model.d,
            f=model.f,
            level=model.level,
            level_of_simulation=level,
            sampling_rate=model.sampling_rate,
            noise_variance=model.noise_variance,
            covariance=None if model.covariance is None else model.covariance.matrix,
            covariance_factor=model.covariance,
            parameter_standard_errors=model.parameter_standard_errors(),
            modes=tuple(model.modes()),
            noise_modes=tuple(model.noise_modes()),
            poles=model.poles(),
            zeros=model.zeros(),
            noise_poles=model.noise_poles(),
            noise_zeros=model.noise_zeros(),
            criteria=estimate.criteria,
            plant_state=estimate.plant_state,
            noise_state=estimate.noise_state,
            window=estimate.window,
            search=SearchRecord(settings, estimate.search.diagnostics, estimate.at_stability_bound),
            transforms=transforms,
            evopem=__version__,
            versions={"python": platform.python_version()}
            | {library: version(library) for library in _LIBRARIES},
            fit=FitRecord.of(estimate, fit) if fit and fit.changes_model else None,
        )

    @property
    def may_be_unstable(self) -> bool:
        """Whether constraints let poles lie on or outside the unit circle."""
        constraints = self.fit.settings.constraints if self.fit else None
        return constraints is not None and (
            constraints.stability == "free" or bool(constraints.fixed_poles)
        )

    @property
    def model(self) -> PolynomialModel:
        """The model itself."""
        return PolynomialModel(
            A=self.a,
            B=self.b,
            C=self.c,
            D=self.d,
            F=self.f,
            nk=self.orders.nk,
            sampling_rate=self.sampling_rate,
            level=self.level,
            noise_variance=self.noise_variance,
            covariance=self.covariance_factor,
            structure=self.orders.structure,
        )


def load_model(path: str | Path) -> PolynomialModel | StateSpaceModel:
    """Read the model of a ``model.json``, or a polynomial model that :func:`.json_form.save` wrote.

    The model of several channels is a state-space model.

    Raises
    ------
    InputError
        When the file is missing, is not a model of evopem, or is a result that was changed.

    Examples
    --------
    Save an estimate as the workflow does, and load its model:

    >>> from tempfile import TemporaryDirectory
    >>> import evopem
    >>> from evopem.config.settings import PreparationSettings, TransformSettings
    >>> from evopem.files.json_form import save
    >>> from evopem.signals.preparation import prepare
    >>> from evopem.synthesis.armax import armax
    >>> unchanged = TransformSettings(box_cox="none", difference=0)
    >>> data = prepare(armax(seed=1, samples=1000)[0], PreparationSettings(unchanged))
    >>> settings = evopem.SearchSettings(objective="quadratic", evaluations=500)
    >>> record = data.estimation
    >>> found = evopem.estimate(record.input, record.output, (2, 2, 2, 3), settings=settings)
    >>> with TemporaryDirectory() as folder:
    ...     save(ModelRecord.of(found, settings, data.transforms), f"{folder}/model.json")
    ...     model = evopem.load(f"{folder}/model.json")
    >>> bool(np.all(model.parameters == found.model.parameters))
    True
    """
    from evopem.estimation.multichannel_record import MultichannelModelRecord

    check_result(path, "summary.json")
    try:
        return load(ModelRecord, path).model
    except InputError as error:
        # Another form of file: only what is no model of any form is refused.
        with suppress(InputError):
            return load(MultichannelModelRecord, path).model
        with suppress(InputError):
            return load(PolynomialModel, path)
        raise InputError(
            error.source, error.problem, "give the model.json of a results folder"
        ) from None
