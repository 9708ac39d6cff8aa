"""The settings of a run and of its data sets, typed.

The default values of these dataclasses are the built-in values of the configuration.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import Literal

from evopem.config.constraints import Constraints
from evopem.errors import InputError

Reference = int | str
"""A channel: its number from 1, or its name, in which a ``*`` stands for any text."""

Range = tuple[int, int]
"""Lower and upper end of a range of orders, both included."""

Synthesis = Literal["flexible_arm", "armax"]
Structure = Literal["fir", "arx", "arma", "armax", "ararx", "ararmax", "oe", "bj", "general"]
InputStructure = Literal["fir", "arx", "armax", "ararx", "ararmax", "oe", "bj", "general"]
StateSpaceForm = Literal["ss", "ss_oe", "ss_oe_drift", "ss_bj"]
ModelForm = StateSpaceForm | InputStructure
OutputWeighting = Literal["determinant", "noise", "power"]
Objective = Literal["absolute", "quadratic"]
OBJECTIVES: tuple[Objective, ...] = ("absolute", "quadratic")
Initialization = Literal["arx", "incremental_order"]
Focus = Literal["prediction", "simulation"] | int
Refine = Literal["worst", "all", "best", "random"]
Recipe = Literal["auto", "chapter"]
Purpose = Literal["auto", "simulation", "prediction", "modes"]

UnevenTime = Literal["refuse", "interpolate"]
"""What is done with a recording whose time stamps are not uniform."""


@dataclass(frozen=True)
class UnitSettings:
    """The units of several channels, in one of three ways; what is empty is not stated."""

    all: str = ""  # of all channels
    in_order: tuple[str, ...] = ()  # one for each
    by_name: dict[str, str] = field(default_factory=dict)


@dataclass(frozen=True)
class ChannelSettings:
    """Which channels of a recorded file are read, and what is known of them.

    Attributes
    ----------
    inputs, outputs : tuple of int or str
        Column numbers from 1, or names of columns, variables or channels; a name with a ``*``
        stands for all that it matches.  No inputs for a structure that has none.
    sampling_rate : float, optional
        Hz; taken from the file or its time column where it is None.
    time : int or str, optional
        The column that holds the time.
    time_unit : str, optional
        Unit of the time stamps; taken from the file where it is None.
    input_units, output_units : UnitSettings
    header_lines : int, optional
        Lines above the first row of numbers of a text table; found where it is None.
    decimal_mark : {".", ","}, optional
        Decimal mark of a text table; found where it is None.
    uneven_time : {"refuse", "interpolate"}
    """

    inputs: tuple[Reference, ...] = (1,)
    outputs: tuple[Reference, ...] = (2,)
    sampling_rate: float | None = None
    time: Reference | None = None
    time_unit: str | None = None
    input_units: UnitSettings = UnitSettings()
    output_units: UnitSettings = UnitSettings()
    header_lines: int | None = None
    decimal_mark: Literal[".", ","] | None = None
    uneven_time: UnevenTime = "refuse"

    @property
    def has_one_output(self) -> bool:
        """Whether there is one output, which no pattern stands for."""
        return len(self.outputs) == 1 and not is_pattern(self.outputs[0])

    @property
    def has_one_input(self) -> bool:
        """Whether there is one input, which no pattern stands for."""
        return len(self.inputs) == 1 and not is_pattern(self.inputs[0])


def is_pattern(reference: object) -> bool:
    """Whether a reference stands for all channels whose names it matches."""
    return isinstance(reference, str) and "*" in reference


@dataclass(frozen=True)
class RecordedSource:
    """Recorded files of one system, and independent ones for validation where there are any.

    Attributes
    ----------
    files : tuple of str
        One, or several that are one data set.
    channels : ChannelSettings
        The same in all files.
    validation_files : tuple of str
    channels_from_file : bool
        Whether input, output and time are decided from the first file, where it has a time.
    """

    files: tuple[str, ...]
    channels: ChannelSettings
    validation_files: tuple[str, ...] = ()
    channels_from_file: bool = False

    @property
    def all_files(self) -> tuple[str, ...]:
        """The recorded files, those for validation last."""
        return (*self.files, *self.validation_files)


@dataclass(frozen=True)
class SyntheticSource:
    """A simulated recording.

    Attributes
    ----------
    synthesis : {"flexible_arm", "armax"}
    seed, samples : int
    sampling_rate : float
        Hz.
    noise : float, optional
        Ratio of noise to output, of the ARMAX recording alone.
    """

    synthesis: Synthesis
    seed: int = 1
    samples: int = 5000
    sampling_rate: float = 100.0
    noise: float | None = None

    @property
    def validation_files(self) -> tuple[str, ...]:
        """None: nothing is recorded."""
        return ()

    @property
    def all_files(self) -> tuple[str, ...]:
        """None: nothing is recorded."""
        return ()


@dataclass(frozen=True)
class TransformSettings:
    """Transforms towards stationarity.

    Attributes
    ----------
    box_cox : float or {"auto", "none"}
        Parameter of the output's Box-Cox transform.
    difference, difference_input : int
        How often the output and the input are differenced.
    """

    box_cox: float | str = 1.1
    difference: int = 2
    difference_input: int = 0


@dataclass(frozen=True)
class SplitSettings:
    """How the samples are divided.

    Attributes
    ----------
    discard : int or float
        Samples, or a share of them, left out at the start.
    estimation : int or float
        Samples, or a share of those that remain, used for estimation.
    by : {"recordings", "samples"}
        How several recordings are divided: the last recordings validate, or the last samples of
        each.
    """

    discard: int | float = 500
    estimation: int | float = 0.8
    by: Literal["recordings", "samples"] = "recordings"


@dataclass(frozen=True)
class PreparationSettings:
    """Everything between a recording and the samples that a model is estimated from.

    Attributes
    ----------
    resample : float, optional
        New sampling rate in Hz.
    """

    transforms: TransformSettings = TransformSettings()
    split: SplitSettings = SplitSettings()
    resample: float | None = None


@dataclass(frozen=True)
class SpectrumSettings:
    """Multitaper estimate: time-halfbandwidth product NW and length of the transforms."""

    time_halfbandwidth: float = 4.0
    nfft: int = 8192


@dataclass(frozen=True)
class DelaySettings:
    """Grid of the delay search: models of joint order k and delay nk over ranges of both."""

    orders: Range = (6, 9)
    nk: Range = (0, 3)


@dataclass(frozen=True)
class OrderSettings:
    """Ranges of the phases of the orders; a structure uses those of the orders that it has.

    The joint range is ``"auto"`` where the spectral peaks give its lower end.
    """

    joint: Range | Literal["auto"] = (6, 14)
    nc: Range = (2, 16)
    nb: Range = (2, 16)
    nd: Range = (0, 4)
    na: Range = (0, 2)


@dataclass(frozen=True)
class OrderGrid:
    """The candidates of all phases of the order search.

    Attributes
    ----------
    delay : DelaySettings
    orders : OrderSettings
    structure : str
        A key of :data:`evopem.config.structures.STRUCTURES`.
    level : bool
        Whether a constant is estimated along.
    """

    delay: DelaySettings = DelaySettings()
    orders: OrderSettings = OrderSettings()
    structure: Structure = "armax"
    level: bool = False


@dataclass(frozen=True)
class SearchSettings:
    """Settings of the search for the parameters of one model.

    Attributes
    ----------
    objective : {"absolute", "quadratic"}
        Sum of absolute prediction errors (chapter eq. 20-21) or of their squares (eq. 22).
    initialization : {"arx", "incremental_order"}
        First individuals: A and B of an ARX model with C at random, as in the chapter, or models
        of smaller orders extended by pairs of roots.
    mu, lambda_ : int
        Parents and offspring of a generation.
    nu : int
        Offspring that BFGS refines in each generation.
    refine : {"worst", "all", "best", "random"}
        Which of the offspring BFGS refines (the chapter's choice, and the three it rejected).
    seed : int
        Seed of every random draw of the search.
    evaluations : int
        Evaluations after which no new generation starts; a gradient counts as one more.
    max_root_radius : float
        Largest radius of the roots of A, C, D and F.
    n_initial_discard : int
        First residuals that the loss leaves out.
    prune : bool
        Whether candidates unlikely to be selected are left after a first pass of their search.
    """

    objective: Objective = "absolute"
    initialization: Initialization = "arx"
    mu: int = 15
    lambda_: int = 100
    nu: int = 10
    refine: Refine = "worst"
    seed: int = 1
    evaluations: int = 20000
    max_root_radius: float = 0.9999
    n_initial_discard: int = 20
    prune: bool = True


@dataclass(frozen=True)
class StateSpaceSearchSettings:
    """Settings of the searches for the parameters of models of several channels.

    Attributes
    ----------
    seed : int
        Seed of every random draw.
    evaluations : int, optional
        Evaluations after which the search of the chosen model begins no new generation; by the
        size of the problem where it is None.
    max_root_radius : float
        Largest radius of the eigenvalues of A and of ``A - K C``.
    objective : {"quadratic", "absolute"}
        ``absolute``: sums of absolute errors, robust to outliers.
    """

    seed: int = 1
    evaluations: int | None = None
    max_root_radius: float = 0.9999
    objective: Objective = "quadratic"


@dataclass(frozen=True)
class FitSettings:
    """What the model of the selected orders is fitted for, and what it must meet.

    Attributes
    ----------
    focus : {"prediction", "simulation"} or int
        Errors of one step, of simulation, or of predictions that many samples ahead.
    constraints : Constraints, optional
    """

    focus: Focus = "prediction"
    constraints: Constraints | None = None

    @property
    def changes_model(self) -> bool:
        """Whether the selected candidate is estimated again."""
        return self != FitSettings()


@dataclass(frozen=True)
class ScoringWindow:
    """The samples on which models are compared.

    Attributes
    ----------
    residual_start : int
        First residual, the same for all orders that are compared, so that a smaller model is a
        special case of a larger one.
    loss_start : int
        First residual that counts in the loss and in all criteria.
    """

    residual_start: int
    loss_start: int

    def from_first(self, first_residual: int) -> ScoringWindow:
        """The same window for orders whose first residual may be later."""
        return ScoringWindow(
            max(self.residual_start, first_residual), max(self.loss_start, first_residual)
        )


@dataclass(frozen=True)
class SampleRequirements:
    """What a record must have for the largest candidate of an order grid.

    Attributes
    ----------
    loss_start : int
        First residual that counts in the loss.
    parameters : int
        Largest number of parameters of any candidate, with level and plant state.
    settling : int
        Samples in which the longest model settles: its memory and its states.
    """

    loss_start: int
    parameters: int
    settling: int


@dataclass(frozen=True)
class InputRanges:
    """Ranges of the inputs, both ends included, in one of three ways; what is missing is decided.

    Examples
    --------
    >>> InputRanges(by_name={"cold": (1, 1)}).of_inputs(("hot", "cold"))
    (None, (1, 1))
    """

    all: Range | None = None  # of all inputs
    in_order: tuple[Range, ...] = ()  # one for each
    by_name: dict[str, Range] = field(default_factory=dict)

    def of_inputs(self, names: Sequence[str], key: str = "") -> tuple[Range | None, ...]:
        """The range of each input; None where none is given.

        Raises
        ------
        InputError
            Naming the key of the configuration, when there are other inputs.
        """
        if self.in_order and len(self.in_order) != len(names):
            raise InputError(
                key,
                f"there are {len(self.in_order)} ranges and {len(names)} inputs",
                "give one range for each, one for all, or a mapping from their names",
            )
        unknown = [name for name in self.by_name if name not in names]
        if unknown:
            raise InputError(
                key, f"there is no input {unknown[0]}", f"name one of {', '.join(names)}"
            )
        if self.in_order:
            return self.in_order
        return tuple(self.by_name.get(name, self.all) for name in names)

    @property
    def given(self) -> tuple[Range, ...]:
        """All ranges that are given."""
        every = (self.all,) if self.all else ()
        return (*every, *self.in_order, *self.by_name.values())


@dataclass(frozen=True)
class OrderRanges:
    """Ranges of orders and delays, both ends included; where there is none, they are decided.

    Attributes
    ----------
    nx : (lower, upper), optional
        Number of states of state-space models.
    joint : (lower, upper), optional
        The order k of polynomial models, that of the degree of A or F.
    na, nc, nd : (lower, upper), optional
        Degrees of A, C and D.
    nb, nf : InputRanges
        Coefficients of B_i, and degree of F_i.
    nk : InputRanges
        Delay of each input in samples, of all models.
    """

    nx: Range | None = None
    joint: Range | None = None
    na: Range | None = None
    nc: Range | None = None
    nd: Range | None = None
    nb: InputRanges = field(default_factory=InputRanges)
    nf: InputRanges = field(default_factory=InputRanges)
    nk: InputRanges = field(default_factory=InputRanges)

    @property
    def of_states(self) -> OrderRanges:
        """The ranges that a search over the orders of state-space models depends on."""
        return OrderRanges(nx=self.nx)

    @property
    def of_polynomials(self) -> OrderRanges:
        """Those of a search over the orders of polynomial models."""
        return replace(self, nx=None)


@dataclass(frozen=True)
class AutomaticSettings:
    """What the configuration decides of an automatic identification; None where the recording does.

    Attributes
    ----------
    purpose : {"auto", "simulation", "prediction", "modes"}
        What the model is for; ``auto`` is simulation, or prediction without inputs.
    structure : str, optional
        ``state_space``, or the structure of a polynomial model of one output.
    form : {"ss", "ss_oe", "ss_oe_drift", "ss_bj"}, optional
        ``ss_oe_drift`` is output-error form with slow changes of the outputs estimated along,
        ``ss_bj`` the optimum of innovations form next to an output-error model and its noise.
    weighting : {"determinant", "noise", "power"}, optional
    orders : OrderRanges
    focus : {"prediction", "simulation"}, optional
        Errors that the forms which are searched are fitted for, with several channels.
    start_given : bool
        Whether ``split.discard`` says where the recording begins.
    rate_given : bool
        Whether ``resample`` says at which rate the model is.
    differences_given : bool
        Whether ``transforms`` say how often the channels are differenced.
    box_cox_given : bool
        Whether ``transforms`` say what is done to the output.
    objective : {"absolute", "quadratic"}, optional
    evaluations : int, optional
        Of the last search.
    """

    purpose: Purpose = "auto"
    structure: Literal["state_space"] | Structure | None = None
    form: StateSpaceForm | None = None
    weighting: OutputWeighting | None = None
    orders: OrderRanges = OrderRanges()
    focus: Literal["prediction", "simulation"] | None = None
    start_given: bool = False
    rate_given: bool = False
    differences_given: bool = False
    box_cox_given: bool = False
    objective: Objective | None = None
    evaluations: int | None = None

    @property
    def other_purpose(self) -> Literal["simulation", "prediction"]:
        """The purpose whose model is kept beside that for the purpose."""
        return "prediction" if self.purpose in ("auto", "simulation") else "simulation"


Vector = tuple[float, float, float]


@dataclass(frozen=True)
class ChannelPlace:
    """Where an output was measured: a point, and a direction of any length above 0."""

    point: str
    direction: Vector


@dataclass(frozen=True)
class Geometry:
    """The structure that mode shapes are drawn over.

    Attributes
    ----------
    points : dict of str to (3,) tuple of float
        Coordinates.
    lines : tuple of (2,) tuples of str
        Pairs of points.
    channels : dict of str to ChannelPlace
        By the names of outputs.
    """

    points: dict[str, Vector]
    lines: tuple[tuple[str, str], ...]
    channels: dict[str, ChannelPlace]


@dataclass(frozen=True)
class DatasetSettings:
    """All settings of one data set, of any number of channels.

    Attributes
    ----------
    name : str
    source : RecordedSource or SyntheticSource
    preparation : PreparationSettings
    spectrum : SpectrumSettings
    order_grid : OrderGrid
        Of the chapter's recipe alone.
    search : SearchSettings
    automatic : AutomaticSettings, optional
        Of the automatic recipe; None for the chapter's.
    fit : FitSettings
    geometry : Geometry, optional
    """

    name: str
    source: RecordedSource | SyntheticSource
    preparation: PreparationSettings
    spectrum: SpectrumSettings
    order_grid: OrderGrid
    search: SearchSettings
    automatic: AutomaticSettings | None = None
    fit: FitSettings = FitSettings()
    geometry: Geometry | None = None

    @property
    def recipe(self) -> Recipe:
        """Which of the two recipes identifies the data set."""
        return "chapter" if self.automatic is None else "auto"

    @property
    def channels(self) -> ChannelSettings:
        """The channels of the recorded files; of a synthetic recording the built-in ones."""
        source = self.source
        return ChannelSettings() if isinstance(source, SyntheticSource) else source.channels

    @property
    def is_single_channel(self) -> bool:
        """Whether there are polynomial models of at most one input, and one output."""
        if self.automatic is None:
            return True
        own, channels = self.automatic, self.channels
        of_states = own.structure == "state_space" or own.form or own.weighting or own.orders.nx
        one_of_each = channels.has_one_input and channels.has_one_output
        return one_of_each and not of_states and self.geometry is None

    @property
    def state_space_search(self) -> StateSpaceSearchSettings:
        """The settings of the searches for models of several channels."""
        search, own = self.search, self.automatic or AutomaticSettings()
        return StateSpaceSearchSettings(
            search.seed, own.evaluations, search.max_root_radius, search.objective
        )


@dataclass(frozen=True)
class RunSettings:
    """How a run is divided into jobs, and what it writes.

    Attributes
    ----------
    candidates_per_job : int or "auto"
        With ``"auto"`` one job estimates all candidates of a phase, on all its cores.
    one_job_per : {"auto", "stage", "recording"}
        With ``"auto"`` the recording for ten data sets and more, and where a job takes several.
    report : {"html", "none"}
    shard : str, optional
        Number of a shard and of all shards, such as ``3/40``.
    follow : str, optional
        Name of the condition that recordings are ordered by where modes are followed.
    recordings_per_job : int or "auto", optional
        With ``"auto"`` as many as take about two minutes. None for one, with all its files.
    """

    candidates_per_job: int | Literal["auto"] = "auto"
    one_job_per: Literal["auto", "stage", "recording"] = "auto"
    report: Literal["html", "none"] = "html"
    shard: str | None = None
    follow: str | None = None
    recordings_per_job: int | Literal["auto"] | None = None
