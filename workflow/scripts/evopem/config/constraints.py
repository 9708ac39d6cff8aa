"""What is required or known of a model beforehand: constraints and priors, in a user's units."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import Annotated, Literal

from pydantic import ConfigDict, Field

from evopem.config.channels import key

Hertz = Annotated[float, Field(ge=0, le=1e12)]
Band = Annotated[tuple[Hertz, Hertz], key("two frequencies in Hz")]
Bounds = tuple[float | None, float | None]
"""Lower and upper bound; either may be None."""


@dataclass(frozen=True)
class FixedPole:
    """A known pole of the plant: a real one, or a pair of known frequency and damping.

    Attributes
    ----------
    real : float, optional
        Position of a real pole in the z plane; 1 is an integrator.
    frequency_hz : float, optional
        Undamped natural frequency of a pair.
    damping_ratio : float, optional
        Damping ratio of that pair, at least 0 and less than 1.
    """

    __pydantic_config__ = ConfigDict(extra="forbid", strict=True)
    real: float | None = None
    frequency_hz: float | None = None
    damping_ratio: float | None = None


@dataclass(frozen=True)
class Prior:
    """Gaussian knowledge of one number of a model.

    Attributes
    ----------
    quantity : str
        A coefficient such as ``a1``, ``b0`` or ``f2``; ``static_gain``; ``frequency`` (Hz) or
        ``damping`` (ratio) of one mode of the plant.
    mean : float
    standard_deviation : float
        Its weight: the prior counts as one more observation with this standard error.
    mode_hz : float, optional
        Which mode is meant: the one nearest to this frequency in Hz.  Needed for ``damping``;
        for ``frequency`` it is the mean by default.
    """

    __pydantic_config__ = ConfigDict(extra="forbid", strict=True)
    quantity: str
    mean: float
    standard_deviation: float
    mode_hz: float | None = None


@dataclass(frozen=True)
class Constraints:
    """Constraints of the plant ``B / (A F)`` and of coefficients; the default is a stable plant.

    All but the priors hold exactly in every model that is returned.

    Attributes
    ----------
    stability : {"required", "free"}
        ``free``: roots of A may lie on or outside the unit circle.  Roots of F may not: the
        predictor filters through 1/F.  Fixed poles are exempt.
    max_pole_radius : float, optional
        Largest radius of the plant's poles in the z plane.
    min_damping_ratio : float, optional
        Least damping ratio of the plant's modes.  A negative real pole counts as a mode at half
        the sampling rate.
    frequency_band : (lower, upper), optional
        Hz; undamped natural frequencies of the plant's modes lie inside.  Negative real poles are
        then forbidden.
    forbidden_bands : tuple of (lower, upper)
        Hz; no mode of the plant has its undamped natural frequency in one of these.
    real_poles : {"any", "positive", "none"}
        Real poles that the plant may have.
    static_gain : float or dict of str to float, optional
        ``B(1) / (A(1) F(1))``, in output units per input unit; of several inputs by their names.
    static_gain_bounds : (lower, upper) or dict of str to (lower, upper), optional
        Either may be None.
    fixed_coefficients : mapping of str to float
        For instance ``{"a1": -1.5, "b0": 0.0}``; ``b0`` is the first coefficient of B, at lag nk.
    fixed_poles : tuple of FixedPole
        Poles of F, or of A in a structure without F.
    priors : tuple of Prior
    """

    stability: Annotated[Literal["required", "free"], key("the stability of the plant")] = (
        "required"
    )
    max_pole_radius: Annotated[
        Annotated[float, Field(gt=0, le=1000)] | None,
        key("the largest radius of a pole of the plant"),
    ] = None
    min_damping_ratio: Annotated[
        Annotated[float, Field(ge=0, lt=1)] | None, key("the least damping ratio of a mode")
    ] = None
    frequency_band: Annotated[Band | None, key("two frequencies in Hz")] = None
    forbidden_bands: Annotated[
        tuple[Band, ...], key("a list of bands in Hz, such as [[9, 11]]")
    ] = ()
    real_poles: Annotated[
        Literal["any", "positive", "none"], key("the real poles that the plant may have")
    ] = "any"
    static_gain: Annotated[
        float | dict[str, float] | None,
        key("a number; of several inputs a mapping from their names, such as {hot: 2.0}"),
    ] = None
    static_gain_bounds: Annotated[
        Bounds | dict[str, Bounds] | None,
        key(
            "two numbers, [lower, upper], either of which may be null; of several inputs a"
            " mapping from their names"
        ),
    ] = None
    fixed_coefficients: Annotated[
        dict[str, float], key("coefficients with their values, such as {a1: -1.5}")
    ] = field(default_factory=dict)
    fixed_poles: Annotated[
        tuple[
            Annotated[FixedPole, key("{real: ...} or {frequency_hz: ..., damping_ratio: ...}")], ...
        ],
        key(
            "a list of poles, such as [{real: 1.0}] or [{frequency_hz: 12.0, damping_ratio: 0.01}]"
        ),
    ] = ()
    priors: Annotated[
        tuple[
            Annotated[Prior, key("a mapping of quantity, mean, standard_deviation and mode_hz")],
            ...,
        ],
        key("a list of priors, such as [{quantity: b0, mean: 2.0, standard_deviation: 0.1}]"),
    ] = ()

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

    def gain_of(self, name: str = "") -> float | None:
        """The given static gain from an input."""
        gain = self.static_gain
        return gain.get(name) if isinstance(gain, dict) else gain

    def gain_bounds_of(self, name: str = "") -> Bounds | None:
        """The bounds of the static gain from an input."""
        bounds = self.static_gain_bounds
        return bounds.get(name) if isinstance(bounds, dict) else bounds

    def of_input(self, name: str) -> Constraints:
        """The constraints of the path from one input: its static gain as a number."""
        return replace(
            self, static_gain=self.gain_of(name), static_gain_bounds=self.gain_bounds_of(name)
        )
