"""What is required or known of a model beforehand: constraints and priors, in a user's units."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace
from typing import Annotated, Literal, Self

from pydantic import ConfigDict, Field

from evopem.config.channels import key

Hertz = Annotated[float, Field(ge=0, le=1e12)]
Band = Annotated[tuple[Hertz, Hertz], key("two frequencies in Hz")]
Bounds = tuple[float | None, float | None]  # lower and upper bound; either may be None

Rule = tuple[bool, str, str, str]
"""Whether a constraint is refused, its key, the problem, and the remedy."""


@dataclass(frozen=True)
class FixedPole:
    """A known pole of the plant: a real one, or a pair of known frequency and damping."""

    __pydantic_config__ = ConfigDict(extra="forbid", strict=True)
    real: float | None = None
    """Position of a real pole in the z plane; 1 is an integrator."""
    frequency_hz: float | None = None
    """Undamped natural frequency of a pair."""
    damping_ratio: float | None = None
    """Damping ratio of that pair, at least 0 and less than 1."""


@dataclass(frozen=True)
class Prior:
    """Gaussian knowledge of one number of a model."""

    __pydantic_config__ = ConfigDict(extra="forbid", strict=True)
    quantity: str
    """A coefficient such as ``a1``, ``b0`` or ``f2``; ``static_gain``; ``frequency`` (Hz) or
    ``damping`` (ratio) of one mode of the plant."""
    mean: float
    standard_deviation: float
    """Its weight: the prior counts as one more observation with this standard error."""
    mode_hz: float | None = None
    """Which mode is meant: the one nearest to this frequency in Hz.  Needed for ``damping``; for
    ``frequency`` it is the mean by default."""

    @property
    def subject(self) -> tuple[str, float | None]:
        """The quantity, and the frequency of its mode."""
        of_mean = self.quantity == "frequency" and self.mode_hz is None
        return self.quantity, self.mean if of_mean else self.mode_hz


@dataclass(frozen=True)
class Constraints:
    """Constraints of the plant ``B / (A F)`` and of coefficients; the default is a stable plant.

    All but the priors hold exactly in every model that is returned.
    """

    stability: Literal["required", "free"] = "required"
    """the stability of the plant. `free`: roots of A may lie on or outside the unit circle; roots
    of F may not, because the predictor filters through 1/F. Fixed poles are exempt"""
    max_pole_radius: Annotated[float, Field(gt=0, le=1000)] | None = None
    """the largest radius of a pole of the plant"""
    min_damping_ratio: Annotated[float, Field(ge=0, lt=1)] | None = None
    """the least damping ratio of a mode. A negative real pole is one at half the sampling rate"""
    frequency_band: Band | None = None
    """two frequencies in Hz. Undamped natural frequencies of the plant lie between them; negative
    real poles are then forbidden"""
    forbidden_bands: tuple[Band, ...] = ()
    """a list of bands in Hz, such as [[9, 11]]. No natural frequency of the plant lies in one"""
    real_poles: Literal["any", "positive", "none"] = "any"
    """the real poles that the plant may have"""
    static_gain: float | dict[str, float] | None = None
    """a number; of several inputs a mapping from their names, such as {hot: 2.0}. `B(1) / (A(1)
    F(1))` in output units per input unit"""
    static_gain_bounds: Bounds | dict[str, Bounds] | None = None
    """two numbers, [lower, upper], either of which may be null; of several inputs a mapping from
    their names"""
    fixed_coefficients: dict[str, float] = field(default_factory=dict)
    """coefficients with their values, such as {a1: -1.5}. `b0` is the first one of B, at lag nk"""
    fixed_poles: tuple[
        Annotated[FixedPole, key("{real: ...} or {frequency_hz: ..., damping_ratio: ...}")], ...
    ] = ()
    """a list of poles, such as [{real: 1.0}] or [{frequency_hz: 12.0, damping_ratio: 0.01}]. Of
    F, or of A in a structure without F"""
    priors: tuple[
        Annotated[Prior, key("a mapping of quantity, mean, standard_deviation and mode_hz")], ...
    ] = ()
    """a list of priors, such as [{quantity: b0, mean: 2.0, standard_deviation: 0.1}]"""

    @property
    def of_free_poles(self) -> bool:
        """Whether the positions of the poles are restricted beyond the stability of the plant."""
        return (
            self.max_pole_radius is not None
            or self.min_damping_ratio is not None
            or self.frequency_band is not None
            or bool(self.forbidden_bands)
            or self.real_poles != "any"
        )

    @property
    def of_coefficients(self) -> list[tuple[str, str]]:
        """Keys of fixed coefficients and priors, with what they are of."""
        fixed = [(f"fixed_coefficients.{name}", name) for name in self.fixed_coefficients]
        return fixed + [(f"priors[{k}]", prior.quantity) for k, prior in enumerate(self.priors)]

    def gain_of(self, name: str = "") -> float | None:
        """The given static gain from an input."""
        gain = self.static_gain
        return gain.get(name) if isinstance(gain, dict) else gain

    def gain_bounds_of(self, name: str = "") -> Bounds | None:
        """The bounds of the static gain from an input."""
        bounds = self.static_gain_bounds
        return bounds.get(name) if isinstance(bounds, dict) else bounds

    def of_input(self, name: str) -> Self:
        """The constraints of the path from one input: its static gain as a number."""
        return replace(
            self, static_gain=self.gain_of(name), static_gain_bounds=self.gain_bounds_of(name)
        )


def gains_of_other_inputs(constraints: Constraints, names: Sequence[str]) -> Iterator[Rule]:
    """Static gains of inputs that there are not."""
    for gain in ("static_gain", "static_gain_bounds"):
        given = getattr(constraints, gain)
        for name in given if isinstance(given, dict) else ():
            known = f"name one of {', '.join(names)}" if names else "write the value alone"
            yield name not in names, gain, f"there is no input {name}", known


def of_no_input(constraints: Constraints) -> Iterator[Rule]:
    """What does not say which of several inputs it is of."""
    for gain in ("static_gain", "static_gain_bounds"):
        yield (
            not isinstance(getattr(constraints, gain), dict | None),
            gain,
            "there are several inputs, each with a gain of its own",
            "write a mapping from their names, such as {hot: 2.0}",
        )
    for place, name in constraints.of_coefficients:
        yield (
            name == "static_gain" or (name[:1] in ("b", "f") and name[1:].isdecimal()),
            place,
            f"each of several inputs has {name}",
            "leave it out, or identify one input alone",
        )


def of_coefficients_in_state_space(constraints: Constraints) -> Iterator[Rule]:
    """What a state-space model has no coefficients for."""
    problem = (
        "the matrices of a state-space model depend on the choice of its states, so that"
        " none of its coefficients has a value of its own"
    )
    remedy = "constrain poles or the static gain, or use a polynomial structure"
    yield from ((True, place, problem, remedy) for place, _ in constraints.of_coefficients)
