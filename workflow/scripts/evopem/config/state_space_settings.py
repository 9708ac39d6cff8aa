"""The settings of a data set with several channels, typed."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import Literal

from evopem.config.constraints import Constraints
from evopem.config.input_ranges import InputRanges
from evopem.config.settings import (
    ChannelSettings,
    Objective,
    Purpose,
    Range,
    SplitSettings,
    UnevenTime,
)
from evopem.config.structures import STRUCTURES

Reference = int | str
StateSpaceForm = Literal["ss", "ss_oe", "ss_oe_drift", "ss_bj"]
InputStructure = Literal["fir", "arx", "armax", "ararx", "ararmax", "oe", "bj", "general"]
ModelForm = StateSpaceForm | InputStructure
OutputWeighting = Literal["determinant", "noise", "power"]

Vector = tuple[float, float, float]


@dataclass(frozen=True)
class UnitSettings:
    """The units of several channels, in one of three ways; what is empty is not stated.

    Attributes
    ----------
    all : str
        One unit of all channels.
    in_order : tuple of str
        One unit for each channel.
    by_name : dict of str to str
        Units by the names of the channels.
    """

    all: str = ""
    in_order: tuple[str, ...] = ()
    by_name: dict[str, str] = field(default_factory=dict)


@dataclass(frozen=True)
class ChannelLists:
    """Which channels of a recorded file are read, and what is known of them.

    Attributes
    ----------
    inputs, outputs : tuple of int or str
        Column numbers from 1, or names; a name with a ``*`` stands for all that it matches.
        No inputs for a structure that is identified from its outputs alone.
    sampling_rate, time, time_unit, header_lines, decimal_mark, uneven_time
        As in :class:`.ChannelSettings`.
    input_units, output_units : UnitSettings
    """

    inputs: tuple[Reference, ...]
    outputs: tuple[Reference, ...]
    sampling_rate: float | None = None
    time: Reference | None = None
    time_unit: str | None = None
    input_units: UnitSettings = UnitSettings()
    output_units: UnitSettings = UnitSettings()
    header_lines: int | None = None
    decimal_mark: Literal[".", ","] | None = None
    uneven_time: UnevenTime = "refuse"


def channel_lists(channels: ChannelSettings | ChannelLists) -> ChannelLists:
    """The channels of a data set with one input and one output, or with one output alone."""
    if isinstance(channels, ChannelLists):
        return channels
    return ChannelLists(
        inputs=() if channels.input is None else (channels.input,),
        outputs=(channels.output,),
        sampling_rate=channels.sampling_rate,
        time=channels.time,
        time_unit=channels.time_unit,
        input_units=UnitSettings(channels.input_unit),
        output_units=UnitSettings(channels.output_unit),
        header_lines=channels.header_lines,
        decimal_mark=channels.decimal_mark,
        uneven_time=channels.uneven_time,
    )


@dataclass(frozen=True)
class MultichannelSource:
    """Recorded files with several channels, and independent ones for validation.

    Attributes
    ----------
    files : tuple of str
        Of one recording, or of several of one system.
    channels : ChannelLists
    validation_files : tuple of str
    """

    files: tuple[str, ...]
    channels: ChannelLists
    validation_files: tuple[str, ...] = ()

    @property
    def all_files(self) -> tuple[str, ...]:
        """The recorded files, those for validation last."""
        return (*self.files, *self.validation_files)


@dataclass(frozen=True)
class OrderRanges:
    """Ranges of orders and delays, both ends included; where there is none, they are decided.

    Attributes
    ----------
    nx : (lower, upper), optional
        Number of states of state-space models.
    joint : (lower, upper), optional
        The joint order of polynomial models.
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

    def of_form(self, form: str) -> OrderRanges:
        """The ranges that a search over the orders of a form depends on."""
        if is_polynomial(form):
            return replace(self, nx=None)
        return OrderRanges(nx=self.nx)


@dataclass(frozen=True)
class StateSpaceChoices:
    """What the configuration decides of a state-space model.

    Attributes
    ----------
    purpose : {"auto", "simulation", "prediction", "modes"}
        What the model is for; ``auto`` is simulation, or prediction without inputs.
    structure : str, optional
        ``state_space``, or the structure of a polynomial model with one output.
    form : {"ss", "ss_oe", "ss_oe_drift", "ss_bj"}, optional
        ``ss_oe_drift`` is output-error form with slow changes of the outputs estimated
        along, ``ss_bj`` the optimum of innovations form next to an output-error model with
        its noise model.  None, here and below, where the recording decides.
    weighting : {"determinant", "noise", "power"}, optional
    orders : OrderRanges
    focus : {"prediction", "simulation"}, optional
        Errors that the searched forms are fitted for.
    """

    purpose: Purpose = "auto"
    structure: Literal["state_space"] | InputStructure | None = None
    form: StateSpaceForm | None = None
    weighting: OutputWeighting | None = None
    orders: OrderRanges = OrderRanges()
    focus: Literal["prediction", "simulation"] | None = None


@dataclass(frozen=True)
class StateSpaceSearchSettings:
    """Settings of the searches for the parameters of state-space models.

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
class ChannelPlace:
    """Where an output was measured.

    Attributes
    ----------
    point : str
        Name of a point.
    direction : (3,) tuple of float
        Direction in which the channel is positive, of any length above 0.
    """

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
class MultichannelDataset:
    """All settings of one data set with several channels.

    Attributes
    ----------
    name : str
    source : MultichannelSource
    split : SplitSettings
    resample : float, optional
        New sampling rate in Hz; None where it is decided, or kept.
    rate_given : bool
        Whether ``resample`` is written: then nothing is decimated.
    choices : StateSpaceChoices
    search : StateSpaceSearchSettings
    geometry : Geometry, optional
    constraints : Constraints, optional
        Of a polynomial structure.
    """

    name: str
    source: MultichannelSource
    split: SplitSettings = field(default_factory=lambda: SplitSettings(discard=0))
    resample: float | None = None
    rate_given: bool = False
    choices: StateSpaceChoices = StateSpaceChoices()
    search: StateSpaceSearchSettings = StateSpaceSearchSettings()
    geometry: Geometry | None = None
    constraints: Constraints | None = None


VARIANTS = (
    ("ss", "determinant"),
    ("ss_oe", "noise"),
    ("ss_oe_drift", "noise"),
    ("ss_bj", "determinant"),
)
"""Forms of state-space models with their weightings of the outputs that are searched where nothing
is given."""

OF_ABSOLUTE_ERRORS = "noise"
"""Weighting of the outputs by absolute errors, of which no determinant can be taken."""

ONE_OUTPUT = "determinant"
"""Weighting of polynomial models: of one output there is nothing to weigh."""

OF_SIMULATION = ("ss_oe", "ss_oe_drift", "oe", "fir")
"""Forms and structures that are fitted to errors of simulation."""

MULTI_INPUT_STRUCTURES = ("arx", "armax", "oe", "bj")
"""Structures of polynomial models that are searched beside, where there is one output."""


def is_polynomial(form: str) -> bool:
    """Whether a form is a structure of polynomial models.

    Examples
    --------
    >>> is_polynomial("oe"), is_polynomial("ss_oe")
    (True, False)
    """
    return form in STRUCTURES


def variant_name(form: str, weighting: str) -> str:
    """The name of a form with its weighting, as in names of files.

    Examples
    --------
    >>> variant_name("ss", "noise"), variant_name("armax", "determinant")
    ('ss_noise', 'armax')
    """
    return form if is_polynomial(form) else f"{form}_{weighting}"


def searched_variants(dataset: MultichannelDataset) -> tuple[tuple[str, str], ...]:
    """The forms with their weightings that a data set searches.

    Examples
    --------
    >>> source = MultichannelSource(("a.csv",), ChannelLists((1,), (2, 3)))
    >>> searched_variants(MultichannelDataset("a", source))
    (('ss', 'determinant'), ('ss_oe', 'noise'), \
('ss_oe_drift', 'noise'), ('ss_bj', 'determinant'))
    >>> choices = StateSpaceChoices(weighting="power")
    >>> searched_variants(MultichannelDataset("a", source, choices=choices))[0]
    ('ss', 'power')
    >>> choices = StateSpaceChoices(focus="simulation")
    >>> searched_variants(MultichannelDataset("a", source, choices=choices))
    (('ss_oe', 'noise'), ('ss_oe_drift', 'noise'))
    >>> search = StateSpaceSearchSettings(objective="absolute")
    >>> searched_variants(MultichannelDataset("a", source, search=search))[0]
    ('ss', 'noise')
    >>> source = MultichannelSource(("a.csv",), ChannelLists((1, 2), (3,)))
    >>> [form for form, _ in searched_variants(MultichannelDataset("a", source))]
    ['ss', 'ss_oe', 'ss_oe_drift', 'ss_bj', 'arx', 'armax', 'oe', 'bj']
    """
    choices, channels = dataset.choices, dataset.source.channels
    if choices.structure is not None and is_polynomial(choices.structure):
        return ((choices.structure, ONE_OUTPUT),)
    forms = [form for form, _ in VARIANTS if choices.form in (None, form)]
    if not channels.inputs:
        forms = ["ss"]
    built_in = dict(VARIANTS)
    if dataset.search.objective == "absolute":
        built_in = dict.fromkeys(built_in, OF_ABSOLUTE_ERRORS)
    variants = tuple((form, choices.weighting or built_in[form]) for form in forms)
    undecided = (choices.structure, choices.form, choices.weighting) == (None, None, None)
    if undecided and channels.inputs and has_one_output(channels):
        variants += tuple((structure, ONE_OUTPUT) for structure in MULTI_INPUT_STRUCTURES)
    return tuple(each for each in variants if is_fitted_for(each[0], choices.focus))


def is_fitted_for(form: str, focus: str | None) -> bool:
    """Whether a form is fitted to the errors in focus.

    Examples
    --------
    >>> is_fitted_for("oe", "simulation"), is_fitted_for("ss_oe", "prediction")
    (True, False)
    """
    return focus is None or (form in OF_SIMULATION) == (focus == "simulation")


def has_one_output(channels: ChannelLists) -> bool:
    """Whether there is one output, which no pattern stands for."""
    return len(channels.outputs) == 1 and not is_pattern(channels.outputs[0])


def is_pattern(reference: object) -> bool:
    """Whether a reference stands for all channels whose names it matches."""
    return isinstance(reference, str) and "*" in reference
