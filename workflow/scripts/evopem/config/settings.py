"""The settings of a data set and of a run: each field with its default, bounds and description.

The fields are the one home of a key of ``config.yaml``: :mod:`evopem.config.schema` takes from them
what it refuses, the JSON schema and the tables of the documentation. The text below a field begins
with the clause that ends an error ("give ..."); the documentation has the rest as well.
"""

from dataclasses import dataclass, field
from typing import Annotated, Literal, Self

from pydantic import Field

from evopem.config.channels import (
    ChannelSettings,
    Geometry,
    RecordedSource,
    Seed,
    SyntheticSource,
    built_in,
)
from evopem.config.constraints import Constraints
from evopem.config.strict_yaml import Keys

Range = tuple[int, int]  # lower and upper end of a range of orders, both included

Structure = Literal[
    "fir", "impulse", "arx", "arma", "armax", "ararx", "ararmax", "oe", "bj", "general"
]
StateSpaceForm = Literal["ss", "ss_oe", "ss_oe_drift", "ss_bj"]
OutputWeighting = Literal["determinant", "noise", "power"]
Objective = Literal["absolute", "quadratic"]
OBJECTIVES: tuple[Objective, ...] = ("absolute", "quadratic")
Focus = Literal["prediction", "simulation"] | Annotated[int, Field(ge=1, le=100_000)]
Hold = Literal["zero-order", "first-order"]
"""How an input runs between its samples: constant, or along a straight line."""
Refine = Literal["worst", "all", "best", "random"]
Recipe = Literal["auto", "chapter"]
Purpose = Literal["auto", "simulation", "prediction", "modes"]
Differences = Annotated[int, Field(ge=0, le=4)]
Share = Annotated[float, Field(gt=0, le=1)]  # a fraction of the samples


@dataclass(frozen=True)
class TransformSettings:
    """Transforms towards stationarity."""

    box_cox: Annotated[float, Field(ge=-100, le=100)] | Literal["auto", "none"] = 1.1
    """the parameter λ of the Box-Cox transform of the output. `auto` is the λ of largest
    likelihood"""
    difference: Differences = 2
    """the number of times to difference the output"""
    difference_input: Differences = 0
    """the number of times to difference the input"""
    difference_pole: Annotated[float, Field(ge=0, lt=1)] = 0.0
    """the pole of a high-pass filter in place of first differences of input and output"""


@dataclass(frozen=True)
class SplitSettings:
    """How the samples are divided."""

    discard: Annotated[int, Field(ge=0)] | Annotated[float, Field(ge=0, le=1)] = 500
    """the samples left out at the start, a whole number of at least 0 or a fraction between 0
    and 1"""
    estimation: Annotated[int, Field(gt=0)] | Share = 0.8
    """the samples for estimation, a whole number of at least 1 or a fraction between 0 and 1. The
    rest validates. Less where the [input rests](#an-input-that-rests) in the rest. `1.0`, all of
    them, needs a `validation_file`, and is then built in"""
    by: Literal["recordings", "samples"] = "recordings"
    """what is held out of several recordings, the last recordings or the last samples of each"""


@dataclass(frozen=True)
class PreparationSettings:
    """Everything between a recording and the samples that a model is estimated from."""

    transforms: TransformSettings = TransformSettings()
    split: SplitSettings = SplitSettings()
    resample: float | None = None  # new sampling rate in Hz


@dataclass(frozen=True)
class SpectrumSettings:
    """The multitaper estimate of the spectrum."""

    time_halfbandwidth: Annotated[float, Field(ge=1.5, le=1000)] = 4.0
    """the time-halfbandwidth product NW of the tapers"""
    nfft: Annotated[int, Field(ge=16, le=2**26)] = 8192
    """the length of the Fourier transforms"""


Count = Annotated[int, Field(ge=1, le=100_000)]


@dataclass(frozen=True)
class SearchSettings:
    """Settings of the search for the parameters of one model."""

    objective: Objective = "absolute"
    """the loss of the prediction errors. `absolute`, their sum, is robust to outliers; `quadratic`
    is efficient for Gaussian noise"""
    mu: Count = 15
    """the number of parents"""
    lambda_: Count = 100
    """the number of offspring"""
    nu: Count = 10
    """the number of offspring that BFGS refines in each generation"""
    refine: Refine = "worst"
    """the offspring that BFGS refines"""
    seed: Seed = 1
    evaluations: Annotated[
        int, Field(ge=1, le=10**12), built_in("20000, with several inputs 10000")
    ] = 20000
    """the number of evaluations of the objective in a search, after which no new restart begins. m²
    times as many of polynomials with m inputs"""
    max_root_radius: Annotated[
        float, Field(gt=0, lt=1), built_in("0.9999, of polynomials by recipe auto 0.9999999")
    ] = 0.9999
    """the largest modulus of a root of A, C, D or F. Of state-space models that of the eigenvalues
    of A and A − K C"""
    n_initial_discard: Annotated[int, Field(ge=0)] = 20
    """the first residuals that the loss leaves out. The initial state of the noise is estimated
    with the model and fits the first nc"""
    prune: bool = True
    """whether candidates that are unlikely to be selected are left after a first pass of their
    search. `false` searches [all](theory.md#search) to the end"""


@dataclass(frozen=True)
class VaryingSettings:
    """The basis along which the coefficients of a model may move."""

    basis: Literal["auto", "legendre", "cosine", "spline"] = "auto"
    """the functions of time. Legendre polynomials, cosines or cubic splines; `auto` is by BIC, or
    Legendre along a condition"""
    dimension: Annotated[int, Field(ge=2, le=30)] | Literal["auto"] = "auto"
    """the number of functions"""
    condition: Annotated[str, Field(min_length=1)] | None = None
    """the name of a condition, such as temperature. Coefficients of several recordings then move
    with it, not with time"""
    values: tuple[Annotated[float, Field(description="a number")], ...] = ()
    """the condition in each recording. In the order of the files, those for validation last"""


@dataclass(frozen=True)
class FitSettings:
    """What the model of the selected orders is fitted for, and what it must meet."""

    focus: Focus = "prediction"  # errors of one step, of simulation, or so many samples ahead
    constraints: Constraints | None = None

    @property
    def changes_model(self) -> bool:
        """Whether the selected candidate is estimated again."""
        return self != FitSettings()


@dataclass(frozen=True)
class ScoringWindow:
    """The samples on which models are compared."""

    residual_start: int  # first residual, the same for all orders that are compared
    loss_start: int  # first residual that counts in the loss and in all criteria

    def from_first(self, first_residual: int) -> Self:
        """The same window for orders whose first residual may be later."""
        return type(self)(
            max(self.residual_start, first_residual), max(self.loss_start, first_residual)
        )


@dataclass(frozen=True)
class SampleRequirements:
    """What a recording must have for the largest candidate of an order grid."""

    loss_start: int
    parameters: int  # of any candidate, at most, with level and plant state
    settling: int  # samples in which the longest model settles: its memory and its states


InputRanges = Range | tuple[Range, ...] | dict[str, Range] | None
"""The range of all inputs, of each in their order, or by their names (:func:`.of_each`)."""


@dataclass(frozen=True)
class OrderRanges:
    """Ranges of orders and delays, both ends included; where there is none, they are decided.

    ``plant`` is the range of the order k of polynomial models, that of the degree of A or F.
    """

    nx: Range | None = None
    plant: Range | None = None
    na: Range | None = None
    nc: Range | None = None
    nd: Range | None = None
    nb: InputRanges = None
    nf: InputRanges = None
    nk: InputRanges = None
    delay: Range | None = None  # orders k of the models whose delays the chapter's recipe compares


CHAPTER_RANGES = OrderRanges(
    plant=(6, 14), nc=(2, 16), nb=(2, 16), nd=(0, 4), na=(0, 2), nk=(0, 3), delay=(6, 9)
)


@dataclass(frozen=True)
class OrderGrid:
    """The candidates of all phases of the chapter's order search."""

    ranges: OrderRanges = CHAPTER_RANGES
    structure: Structure = "armax"
    level: bool = False  # whether a constant is estimated along


@dataclass(frozen=True)
class GivenPreparation:
    """What a configuration decides of an automatic preparation; None is left to the recording."""

    start: int | None = None  # first sample kept of each recording
    factor: int | None = None  # of the decimation
    differences: int | None = None  # further ones of all channels
    objective: Objective | None = None
    box_cox: bool = False  # whether the configuration says what is done


@dataclass(frozen=True)
class AutomaticSettings:
    """What the configuration decides of the automatic recipe; None where the recording does."""

    purpose: Purpose = "auto"  # simulation, or prediction without inputs
    structure: Literal["state_space"] | Structure | None = None
    form: StateSpaceForm | None = None
    weighting: OutputWeighting | None = None
    orders: OrderRanges = OrderRanges()
    preparation: GivenPreparation = GivenPreparation()
    evaluations: int | None = None  # of the last search
    max_root_radius: float | None = None  # of the last search; by the kind of model


@dataclass(frozen=True)
class DatasetSettings:
    """All settings of one data set, of any number of channels."""

    name: str
    keys: Keys = field(compare=False)  # all of them, from which all else follows
    source: RecordedSource | SyntheticSource
    preparation: PreparationSettings
    spectrum: SpectrumSettings
    order_grid: OrderGrid  # of the chapter's recipe alone
    search: SearchSettings
    automatic: AutomaticSettings | None = None  # None for the chapter's recipe
    fit: FitSettings = FitSettings()
    geometry: Geometry | None = None
    continuous_time: Hold | None = None
    varying: VaryingSettings | None = None  # None where no moving model is tried

    @property
    def channels(self) -> ChannelSettings:
        """The channels of the recorded files; of a synthetic recording the built-in ones."""
        source = self.source
        return ChannelSettings() if isinstance(source, SyntheticSource) else source.channels
