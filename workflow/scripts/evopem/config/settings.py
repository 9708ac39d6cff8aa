"""The settings of a run and of its data sets, typed.

The default values of these dataclasses are the built-in values of the configuration.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

from evopem.config.constraints import Constraints

Range = tuple[int, int]
"""Lower and upper end of a range of orders, both included."""

Synthesis = Literal["flexible_arm", "armax"]
Structure = Literal["fir", "arx", "arma", "armax", "ararx", "ararmax", "oe", "bj", "general"]
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
class ChannelSettings:
    """Which channels of a recorded file are read, and what is known of them.

    Attributes
    ----------
    input, output : int or str
        Column number from 1, or name of a column, variable or channel.  Without an input, None.
    sampling_rate : float, optional
        Hz; taken from the file or its time column where it is None.
    time : int or str, optional
        The column that holds the time.
    time_unit : str, optional
        Unit of the time stamps; taken from the file where it is None.
    input_unit, output_unit : str
        Empty where not stated.
    header_lines : int, optional
        Lines above the first row of numbers of a text table; found where it is None.
    decimal_mark : {".", ","}, optional
        Decimal mark of a text table; found where it is None.
    uneven_time : {"refuse", "interpolate"}
    """

    input: int | str | None = 1
    output: int | str = 2
    sampling_rate: float | None = None
    time: int | str | None = None
    time_unit: str | None = None
    input_unit: str = ""
    output_unit: str = ""
    header_lines: int | None = None
    decimal_mark: Literal[".", ","] | None = None
    uneven_time: UnevenTime = "refuse"


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
        Whether input, output and time are told from the first file, where it has a time.
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
class AutomaticSettings:
    """What the configuration decides of an automatic identification.

    Attributes
    ----------
    purpose : {"auto", "simulation", "prediction", "modes"}
        What the model is for; ``auto`` is simulation.
    structure : str, optional
        None, here and below, where the recording decides.
    nk, joint, nc, nd, nb : (lower, upper), optional
        Limits of the orders; ``joint`` is that of the degree of A or F.
    start_given : bool
        Whether ``split.discard`` says where the recording begins.
    rate_given : bool
        Whether ``resample`` says at which rate the model is.
    differences_given : bool
        Whether ``transforms`` say how often the channels are differenced.
    objective : {"absolute", "quadratic"}, optional
    box_cox_given : bool
        Whether ``transforms`` say what is done to the output.
    """

    purpose: Purpose = "auto"
    structure: Structure | None = None
    nk: Range | None = None
    joint: Range | None = None
    nc: Range | None = None
    nd: Range | None = None
    nb: Range | None = None
    start_given: bool = False
    rate_given: bool = False
    differences_given: bool = False
    objective: Objective | None = None
    box_cox_given: bool = False

    @property
    def other_purpose(self) -> Literal["simulation", "prediction"]:
        """The purpose whose model is kept beside that for the purpose."""
        return "prediction" if self.purpose in ("auto", "simulation") else "simulation"


@dataclass(frozen=True)
class DatasetSettings:
    """All settings of one data set.

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
    """

    name: str
    source: RecordedSource | SyntheticSource
    preparation: PreparationSettings
    spectrum: SpectrumSettings
    order_grid: OrderGrid
    search: SearchSettings
    automatic: AutomaticSettings | None = None
    fit: FitSettings = FitSettings()

    @property
    def recipe(self) -> Recipe:
        """Which of the two recipes identifies the data set."""
        return "chapter" if self.automatic is None else "auto"


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
