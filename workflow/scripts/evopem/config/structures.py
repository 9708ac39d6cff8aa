"""The structures of models: their orders and phases, and the forms of state-space models."""

from collections.abc import Mapping
from types import MappingProxyType

from evopem.config.channels import are_one
from evopem.config.constraints import Constraints
from evopem.config.settings import DatasetSettings, FitSettings, OrderRanges
from evopem.errors import InputError

# The orders that each structure has, in the order of MATLAB's tuples (Ljung 1999, chapter 4).
STRUCTURES: Mapping[str, tuple[str, ...]] = MappingProxyType(
    {
        "fir": ("nb", "nk"),
        "impulse": ("nb", "nk"),
        "arx": ("na", "nb", "nk"),
        "arma": ("na", "nc"),
        "armax": ("na", "nb", "nc", "nk"),
        "ararx": ("na", "nb", "nd", "nk"),
        "ararmax": ("na", "nb", "nc", "nd", "nk"),
        "oe": ("nb", "nf", "nk"),
        "bj": ("nb", "nc", "nd", "nf", "nk"),
        "general": ("na", "nb", "nc", "nd", "nf", "nk"),
    }
)

ORDER_NAMES = STRUCTURES["general"]

REGULARISED = ("impulse",)
"""Structures whose coefficients have a prior, which makes one optimum of any length: no search."""

WITHOUT_POLES = ("fir", *REGULARISED)  # structures whose plant is B alone

PHASES = ("delay", "plant", "nc", "nd", "na", "nb")
"""Every phase of an order search, in their order: each takes its predecessor's selection."""

# What the automatic recipe searches, each with those whose optima serve as starts, or tell whether
# it is needed: structures of polynomials, and forms in state space, which differ in the noise and
# the drift.
NESTED: Mapping[str, tuple[str, ...]] = MappingProxyType(
    {
        "fir": (),
        "impulse": (),
        "arx": (),
        "armax": ("arx",),
        "oe": ("armax",),
        "ararx": ("arx",),
        "ararmax": ("armax",),
        "bj": ("armax", "oe"),
        "ss": ("fir", "impulse", "arx", "armax", "oe", "ararx", "ararmax", "bj"),
        "ss_oe": ("ss",),
        "ss_oe_drift": ("ss_oe",),
        "ss_bj": ("ss_oe",),
    }
)

AUTOMATIC_STRUCTURES = tuple(structure for structure in NESTED if structure in STRUCTURES)
"""The structures of polynomials among them."""


def searched_structures(wanted: str) -> tuple[str, ...]:
    """The structures of polynomials that are searched for one of them, itself last."""
    needed = {wanted}
    for structure in reversed(AUTOMATIC_STRUCTURES):
        if structure in needed:
            needed.update(NESTED[structure])
    return (*(s for s in AUTOMATIC_STRUCTURES if s in needed - {wanted}), wanted)


def has_input(structure: str) -> bool:
    """Whether a structure has an input."""
    return "nb" in STRUCTURES[structure]


def phases_of(structure: str) -> tuple[str, ...]:
    """The phases of a structure's order search, in their order."""
    existing = {*STRUCTURES[structure]} | (set() if structure in WITHOUT_POLES else {"plant"})
    if "nk" in existing:
        existing.add("delay")
    if structure != "general":
        existing.discard("na")  # the degree of A is the plant order
    return tuple(phase for phase in PHASES if phase in existing)


def varied_order(phase: str, structure: str) -> str:
    """The order that shows what a phase has selected."""
    if phase == "delay":
        return "nk"
    if phase == "plant":
        return "nf" if "nf" in STRUCTURES[structure] else "na"
    return phase


def plant_order(structure: str) -> str:
    """The order that is the plant order k in the first phase: nf, na, or nb without poles."""
    return "nb" if structure in WITHOUT_POLES else varied_order("plant", structure)


def structure_name(structure: str) -> str:
    """A structure as it is written before its orders: "ARMAX", "OE", "general"."""
    return structure if structure == "general" else structure.upper()


# Forms of state-space models, with their weightings of the outputs where none is given.
STATE_SPACE_FORMS: Mapping[str, str] = MappingProxyType(
    {"ss": "determinant", "ss_oe": "noise", "ss_oe_drift": "noise", "ss_bj": "determinant"}
)

OF_ABSOLUTE_ERRORS = "noise"
"""Weighting of the outputs by absolute errors, of which no determinant can be taken."""

OF_SIMULATION = ("ss_oe", "ss_oe_drift", "oe", *WITHOUT_POLES)
"""Forms and structures that are fitted to errors of simulation."""


def is_polynomial(form: str) -> bool:
    """Whether a form is a structure of polynomial models."""
    return form in STRUCTURES


def samples_ahead(focus: str | int) -> int | None:
    """Samples ahead of the predictions of a focus; None for simulation."""
    if isinstance(focus, int) and not isinstance(focus, bool) and focus >= 1:
        return int(focus)
    if focus not in ("prediction", "simulation"):
        raise ValueError(
            f'focus must be "prediction", "simulation" or a number of samples, not {focus!r}'
        )
    return None if focus == "simulation" else 1


def check_model(
    structure: str, several_outputs: bool, focus: str | int, constraints: Constraints | None
) -> None:
    """Refuse a structure or form that cannot meet what is asked of it, whatever its orders.

    The source of the InputError is the key that asks.
    """
    key = problem = remedy = ""
    if is_polynomial(structure) and several_outputs:
        key, problem = "structure", "a polynomial model has one output, and there are several"
        remedy = "write a state-space structure, which has all of them, or name one output"
    elif structure == "ss" and focus == "simulation":
        key, problem = "focus", "errors of simulation do not depend on the gain K of ss"
        remedy = "write ss_oe, or ss_bj for a noise model beside it"
    elif constraints is not None and structure == "ss_bj":
        key, problem = "constraints", "ss_bj has poles of the plant and of its noise model in one"
        problem += " matrix, and it is not said which of them are meant"
        remedy = "write ss_oe or ss, or a polynomial structure such as oe"
    elif constraints is not None and structure in REGULARISED:
        key, problem = "constraints", "a regularised response has a prior of its own alone"
        remedy = "leave them out, or write another structure, such as fir"
    elif constraints is not None and structure in ("fir", "arma"):
        key, problem = "constraints", f"a model of structure {structure} has no plant with poles"
        remedy = "leave out what they require of poles"
        if not (constraints.of_free_poles or constraints.fixed_poles):
            return
    if key:
        raise InputError(key, problem, remedy)


def searched_forms(dataset: DatasetSettings) -> tuple[str, ...]:
    """The forms and structures that the automatic recipe searches, each behind those it needs.

    Polynomials have one output; without an input they are those of ARMA models.
    """
    given, channels = dataset.automatic, dataset.channels
    if given is None:
        return ()
    if given.structure is not None and is_polynomial(given.structure):
        return searched_structures(given.structure)
    structures: tuple[str, ...] = ()
    if (given.structure, given.form, given.weighting) == (None, None, None) and are_one(
        channels.outputs
    ):
        structures = AUTOMATIC_STRUCTURES if channels.inputs else ("arma",)
    forms = tuple(STATE_SPACE_FORMS) if channels.inputs else ("ss",)
    if structures and given.orders.nx is None and given.orders != OrderRanges(nk=given.orders.nk):
        forms = ()  # ranges of orders of polynomials ask for these
    elif structures and are_one(channels.inputs):
        forms = ("ss",)  # of one input the models of the others are those of oe and bj
    forms = tuple(form for form in forms if given.form in (None, form))
    return tuple(s for s in (*structures, *forms) if _can_meet(s, dataset.fit))


def _can_meet(structure: str, fit: FitSettings) -> bool:
    """Whether a structure that is not written can be fitted for a focus and meet constraints."""
    try:
        check_model(structure, False, fit.focus, fit.constraints)
    except InputError:
        return False
    constraints = fit.constraints
    return (
        is_polynomial(structure)
        or constraints is None
        or not (constraints.of_coefficients or constraints.stability == "free")
    )
