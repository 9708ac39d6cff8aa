"""Keys of a data set that it does not have, or that contradict each other: each in one sentence."""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Self

from evopem.config.channels import NONE, Geometry, Reference, are_one, is_pattern, listed, of_each
from evopem.config.constraints import (
    Constraints,
    gains_of_other_inputs,
    of_coefficients_in_state_space,
    of_no_input,
)
from evopem.config.keys import ANALYSIS, SOURCE, STATE_SPACE, SYNTHESIS
from evopem.config.schema import ALL_SAMPLES
from evopem.config.settings import DatasetSettings
from evopem.config.source_checks import Place
from evopem.config.strict_yaml import Keys
from evopem.config.structures import (
    REGULARISED,
    STRUCTURES,
    WITHOUT_POLES,
    check_model,
    has_input,
    phases_of,
)
from evopem.errors import InputError

STATE_SPACE_KEYS = ("form", "weighting", "geometry")
GROUPS = ("transforms", "split", "spectrum", "delay", "orders", "search", "constraints")
"""Mappings whose keys are laid over those of ``defaults:`` one by one."""
IN_TIME = (
    *("time", "time_unit", "uneven_time", "validation_file", "purpose", "resample", "transforms"),
    *("split", "spectrum", "structure", "form", "weighting", "level", "delay", "focus"),
    *("constraints", "varying"),
)
"""Keys that a data set of frequency responses does not have."""
OF_ONE_OUTPUT = ("transforms.box_cox", "varying")
FEWEST_CONDITIONS = 4
"""Different values of a condition that coefficients move with: a line, and what checks it."""
OF_CHAPTER = (
    *("level", "delay.orders", "search.n_initial_discard", "search.prune"),
    *("search.mu", "search.lambda", "search.nu", "search.refine"),
)
"""Keys that the chapter's recipe alone has."""


@dataclass(frozen=True)
class Kind:
    """What decides which keys a data set has."""

    structure: str | None
    inputs: tuple[Reference, ...]
    outputs: tuple[Reference, ...]
    by_chapter: bool
    synthesis: str | None
    of_responses: bool = False  # whether the file holds frequency responses

    @classmethod
    def of(cls, keys: Keys) -> Self:
        """That of written or built-in keys."""
        of_responses = "frequency" in keys
        structure = None if of_responses else keys.get("structure")
        alone = structure == "arma" and "input" not in keys
        inputs = () if alone else listed(keys.get("input", 1))
        outputs = listed(keys.get("output", 1 if alone else 2))
        by_chapter = keys.get("recipe") == "chapter" and not of_responses
        return cls(structure, inputs, outputs, by_chapter, keys.get("synthesis"), of_responses)

    @property
    def is_polynomial(self) -> bool:
        """Whether a structure of polynomials is written."""
        return self.structure not in (None, STATE_SPACE)

    @property
    def orders(self) -> tuple[str, ...]:
        """The orders that have ranges."""
        if self.of_responses or self.structure == STATE_SPACE or not are_one(self.outputs):
            return ("nx",)
        if self.by_chapter:
            return tuple(name for name in phases_of(self.structure or "armax") if name != "delay")
        names = STRUCTURES[self.structure or "general"]
        plant = ("plant",) if self.structure not in WITHOUT_POLES else ()
        states = () if self.structure else ("nx",)
        return (*states, *plant, *(name for name in names if name != "nk"))

    def __str__(self) -> str:
        """What an error calls a data set of this kind."""
        if self.of_responses:
            return "a data set of frequency responses"
        if self.is_polynomial:
            return f"structure {self.structure}"
        if not are_one(self.outputs):
            return "a data set with several outputs"
        return "the chapter's recipe" if self.by_chapter else "the automatic recipe"

    def absent(self) -> dict[str, tuple[str, str]]:
        """The keys that it does not have, by their paths, each with a problem and a remedy."""
        remove, orders = "remove the key", ", ".join(self.orders)
        source = f"synthesis: {self.synthesis}" if self.synthesis else "file"
        belongs = f"the key belongs to {{}} data set, and this one has `{source}`"
        table = (
            (self.synthesis, SOURCE.keys() - SYNTHESIS.keys(), belongs.format("a recorded")),
            (not self.synthesis, SYNTHESIS.keys() - SOURCE.keys(), belongs.format("a synthetic")),
            (self.synthesis == "flexible_arm", ("noise",), belongs.format("an armax")),
            (self.synthesis == "armax", ("softening",), belongs.format("a flexible_arm")),
            (self.by_chapter, ("purpose",), "the chapter's recipe knows no purpose"),
            (self.by_chapter, STATE_SPACE_KEYS, "the chapter's recipe has polynomial models"),
            (not self.by_chapter, OF_CHAPTER, "the automatic recipe has no such key"),
            (not self.by_chapter, ("level",), "the automatic recipe always estimates a level"),
            (not are_one(self.outputs), OF_ONE_OUTPUT, "there are several outputs"),
            (self.is_polynomial, ("form", "weighting"), f"{self} has no such key"),
            (not self.inputs, ("delay", "input_unit"), "there is no input"),
            (self.of_responses, IN_TIME, "frequency responses are no samples in time"),
        )
        reason = {path: (why, remove) for applies, paths, why in table if applies for path in paths}
        if not self.by_chapter:
            reason["level"] = (reason["level"][0], f"{remove}, or write recipe: chapter")
        of_orders = (f"{self} has no such range", f"remove it, or give one of {orders}")
        ranges = ANALYSIS["orders"].__origin__.__annotations__
        return reason | {f"orders.{r}": of_orders for r in ranges if r not in self.orders}


def paths_of(keys: Keys) -> Iterator[str]:
    """The paths of keys, and of those below each group of them."""
    for key, value in keys.items():
        yield key
        if key in GROUPS:
            yield from (f"{key}.{inner}" for inner in value)


def check_values(keys: Keys, kind: Kind, at: Place) -> None:
    """Refuse values that contradict each other, or the channels."""
    structure, inputs, polynomial = kind.structure, kind.inputs, f"structure {kind.structure}"
    form = keys.get("form", STATE_SPACE if structure is None else structure)
    constraints = Constraints(**keys["constraints"]) if keys.get("constraints") else None
    try:
        check_model(form, not are_one(kind.outputs), keys.get("focus", "prediction"), constraints)
    except InputError as error:
        at.refuse(error.source, error.problem, error.remedy)
    if kind.is_polynomial and inputs and not has_input(form) and "input" in keys:
        remedy = f"write input: {NONE}, or another structure"
        at.refuse("input", f"{polynomial} has no input", remedy)
    if kind.is_polynomial and not inputs and has_input(form):
        problem = f"{polynomial} needs an input, and there is none"
        at.refuse("input", problem, f"write structure: {STATE_SPACE}, or name an input")
    alone = structure == "arma" and are_one(kind.outputs)
    are_pair = are_one(inputs) and are_one(kind.outputs)
    if kind.by_chapter and (structure == STATE_SPACE or not (are_pair or alone)):
        problem = "the chapter's recipe has a polynomial model, and one input and one output"
        at.refuse("recipe", problem, "remove the key: recipe auto finds models of all channels")
    if kind.by_chapter and structure in REGULARISED:
        problem = "the chapter's recipe searches orders, and a regularised response has none"
        at.refuse("recipe", problem, "remove the key, or write structure: fir")
    if kind.by_chapter and not inputs and keys.get("transforms", {}).get("difference_input"):
        problem = f"{polynomial} has no input to difference"
        at.refuse("transforms.difference_input", problem, "set it to 0")
    transforms = keys.get("transforms", {})
    counts = (transforms.get("difference"), transforms.get("difference_input"))
    if transforms.get("difference_pole") and (counts != (1, 1) or not inputs):
        problem = "a high-pass filter takes the place of one difference of each input and output"
        remedy = "write difference: 1, difference_input: 1" if inputs else "leave it out"
        at.refuse("transforms.difference_pole", problem, remedy)
    absolute = keys.get("search", {}).get("objective") == "absolute"
    if keys.get("weighting") == "determinant" and absolute:
        problem = "absolute errors have no covariance whose determinant could be taken"
        remedy = "write weighting: noise or power, or search.objective: quadratic"
        at.refuse("weighting", problem, remedy)
    for key in ("focus", "purpose"):
        if keys.get(key) == "simulation" and not inputs:
            problem = "a model without input has nothing to simulate"
            at.refuse(key, problem, "write prediction, or remove the key")
    if not inputs and keys.get("form", "ss") != "ss":
        problem = f"form {form} has a plant that inputs drive"
        at.refuse("form", problem, "write ss, or remove the key")
    estimation = keys.get("split", {}).get("estimation")
    takes_all = isinstance(estimation, float) and estimation == ALL_SAMPLES
    if takes_all and "validation_file" not in keys:
        problem = f"{estimation} takes all samples, so none are left to validate on"
        remedy = "give a smaller fraction such as 0.8, or a validation_file"
        at.refuse("split.estimation", problem, remedy)
    _check_ranges(keys, kind, at)
    if constraints is not None:
        of_states = structure == STATE_SPACE or "form" in keys or "weighting" in keys
        _check_constraints(constraints, kind, of_states, at)
        if not are_pair and form == STATE_SPACE:
            problem = "what constraints mean depends on the structure, and none is written"
            remedy = "write form: ss_oe or ss, or a polynomial structure such as oe"
            at.refuse("constraints", problem, remedy)
    if "geometry" in keys:
        _check_geometry(keys["geometry"], at)


def check_settings(settings: DatasetSettings, keys: Keys, at: Place) -> None:
    """Refuse sizes of a search that contradict each other, and samples of whole recordings."""
    search, split, source = settings.search, settings.preparation.split, settings.source
    for low, meaning in (
        ("mu", "as many offspring as parents are needed"),
        ("nu", "no more individuals can be improved than there are offspring"),
    ):
        if getattr(search, low) > search.lambda_:
            key = next((key for key in (low, "lambda") if key in keys.get("search", {})), low)
            problem = f"{low} is {getattr(search, low)} and lambda is {search.lambda_}, but"
            at.refuse(f"search.{key}", f"{problem} {meaning}", f"give {low} no more than lambda")
    whole = len(source.all_files) > 1 and split.by == "recordings" and not source.validation_files
    if whole and isinstance(split.estimation, int):
        problem = f"{split.estimation} is a number of samples, and whole recordings are held out"
        remedy = "give a fraction between 0 and 1, or write by: samples beside it to cut each"
        at.refuse("split.estimation", problem, f"{remedy} recording")
    _check_condition(settings, at)


def _check_condition(settings: DatasetSettings, at: Place) -> None:
    """Refuse a condition that is not known of each recording, or takes too few values."""
    varying, recordings = settings.varying, len(settings.source.all_files)
    if varying is None or (varying.condition is None and not varying.values):
        return
    given, levels = len(varying.values), len(set(varying.values))
    problem, remedy, key = "", "give one number for each recording", "values"
    if varying.condition is None:
        problem, remedy, key = "values stand without a condition", "name it", "condition"
    elif given != recordings:
        problem = f"there are {given} values of {varying.condition} and {recordings} recordings"
    elif levels < FEWEST_CONDITIONS:
        problem = f"{varying.condition} takes {levels} different values"
        problem += f", and {FEWEST_CONDITIONS} are needed"
        remedy = "add recordings at other values, or leave the key out"
    elif varying.dimension != "auto" and varying.dimension > levels - 2:
        problem = f"{varying.condition} takes {levels} different values, too few for so many"
        remedy, key = f"give {levels - 2} at most", "dimension"
    if problem:
        at.refuse(f"varying.{key}", problem, remedy)


def _check_ranges(keys: Keys, kind: Kind, at: Place) -> None:
    """Refuse ranges of other inputs, as far as these are known by name before the recording is."""
    inputs = kind.inputs
    by_name = all(isinstance(reference, str) for reference in inputs)
    for group, key in (("delay", "nk"), ("orders", "nb"), ("orders", "nf")):
        if key in keys.get(group, {}) and not any(map(is_pattern, inputs)):
            given = keys[group][key]
            if by_name or are_one(inputs) or not isinstance(given, Mapping):
                of_each(given, tuple(map(str, inputs)), at.source, at.of_key(f"{group}.{key}"))


def _check_constraints(constraints: Constraints, kind: Kind, of_states: bool, at: Place) -> None:
    """Refuse constraints that do not say what they are of."""
    names = [r for r in kind.inputs if isinstance(r, str) and not is_pattern(r)]
    known = are_one(kind.inputs) or len(names) == len(kind.inputs)
    rules = [*gains_of_other_inputs(constraints, names)] if known else []
    if len(kind.inputs) > 1 or any(map(is_pattern, kind.inputs)):
        rules += of_no_input(constraints)
    if of_states:
        rules += of_coefficients_in_state_space(constraints)
        problem = "the search goes through stable models in state space alone"
        remedy = "use a structure with A, such as armax"
        rules.append((constraints.stability == "free", "stability", problem, remedy))
    for applies, key, problem, remedy in rules:
        if applies:
            at.refuse(f"constraints.{key}", problem, remedy)


def _check_geometry(geometry: Geometry, at: Place) -> None:
    """Refuse lines and channels at points that do not exist, and directions of no length."""
    ends = [(f"lines[{index}]", end) for index, line in enumerate(geometry.lines) for end in line]
    ends += [(f"channels.{name}", channel.point) for name, channel in geometry.channels.items()]
    for key, point in ends:
        if point not in geometry.points:
            remedy = f"give one of {', '.join(list(geometry.points)[:20])}"
            at.refuse(f"geometry.{key}", f"there is no point {point}", remedy)
    for name, channel in geometry.channels.items():
        if not any(channel.direction):
            remedy = "give three numbers, not all 0, or one of x, y, z, -x, -y, -z"
            key = f"geometry.channels.{name}.direction"
            at.refuse(key, "the direction has no length", remedy)
