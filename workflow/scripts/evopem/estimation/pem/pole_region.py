"""Where the poles of a plant may lie, and second-order sections that cannot leave that region. Two
*shares* in [0, 1] say where the poles lie: of the largest angle and, at that angle, between the
smallest and the largest radius; or of two real poles between their bounds."""

from dataclasses import dataclass

import numpy as np

from evopem.arrays import Array, Complex

Band = tuple[float, float]

UNBOUNDED_RADIUS = 100.0  # largest radius where the stability of the plant is not required
# A share this close to 0 or 1 lies at the edge, and two edges this close, relatively, coincide.
AT_EDGE = 1e-6
LEAST = 1e-9  # least length under a root: its derivative stays finite at the tip of a band


@dataclass(frozen=True)
class PoleRegion:
    """Region of the poles of a plant: largest radii of real and of complex ones, ``zeta / sqrt(1 -
    zeta^2)`` for the least damping ratio, natural frequencies in radians a sample, bounds of real
    poles or None, the constraint behind the radius, and the band that forbidden ones cut."""

    radius: float
    mode_radius: float
    decay_per_radian: float
    bands: tuple[Band, ...]
    real: Band | None
    radius_name: str
    whole_band: Band = (0.0, np.inf)

    @property
    def kinds(self) -> int:
        """Number of kinds of sections: one for each band, and two real poles where allowed."""
        return len(self.bands) + (self.real is not None)

    def largest_angle(self, band: Band) -> float:
        """Largest angle of a complex pole in a band, radians; negative where the band is empty."""
        upper = band[1]
        if np.isinf(upper):
            return np.pi
        least_decay = -np.log(self.mode_radius)
        if upper <= least_decay:
            return -1.0
        by_radius = float(np.sqrt(upper**2 - least_decay**2))
        return min(np.pi, by_radius, upper / float(np.hypot(1.0, self.decay_per_radian)))

    def edges(self, angle: float, band: Band) -> tuple[dict[str, tuple[float, float]], Band]:
        """Upper edges of the radius at an angle, each with its slope, and the lower edge's."""
        lower, upper = band
        edges = {self.radius_name: (self.mode_radius, 0.0)}
        if self.decay_per_radian > 0.0:
            edge = float(np.exp(-self.decay_per_radian * angle))
            edges["min_damping_ratio"] = edge, -self.decay_per_radian * edge
        if lower > angle:
            edges[self._end_name(lower)] = _circle(lower, angle)
        return edges, _circle(upper, angle) if np.isfinite(upper) else (0.0, 0.0)

    def section(self, kind: int, shares: Array) -> tuple[Array, Array]:
        """``[c_1, c_2]`` of a section, and their derivatives by the shares, (2, 2)."""
        if kind == len(self.bands):
            low, high = self.real or (0.0, 0.0)
            lower_root, upper_root = low + (high - low) * shares
            coefficients = np.array([-lower_root - upper_root, lower_root * upper_root])
            return coefficients, (high - low) * np.array([[-1.0, -1.0], [upper_root, lower_root]])
        band = self.bands[kind]
        largest = self.largest_angle(band)
        angle = largest * shares[0]
        edges, (low, low_slope) = self.edges(angle, band)
        high, high_slope = min(edges.values())
        r = low + (high - low) * shares[1]
        by_angle = low_slope + (high_slope - low_slope) * shares[1]
        radial = np.array([-2.0 * np.cos(angle), 2.0 * r])
        turning = np.array([2.0 * r * np.sin(angle), 0.0])
        derivatives = np.column_stack(
            [largest * (turning + by_angle * radial), (high - low) * radial]
        )
        return np.array([-2.0 * r * np.cos(angle), r**2]), derivatives

    def active(self, kind: int, shares: Array) -> tuple[list[str], list[int]]:
        """Names of the constraints at whose edge a section lies, and the shares that they fix."""
        if kind == len(self.bands):
            names, fixed = [], []
            for index in (0, 1):
                if (name := self.active_real(shares[index])) is not None:
                    names.append(name)
                    fixed.append(index)
            return names, fixed
        band = self.bands[kind]
        largest = self.largest_angle(band)
        edges, _ = self.edges(largest * shares[0], band)
        names, fixed = [], []
        if shares[1] >= 1.0 - AT_EDGE:
            lowest = min(edge for edge, _ in edges.values())
            names = [name for name, (edge, _) in edges.items() if edge <= lowest * (1.0 + AT_EDGE)]
            fixed = [1] if len(names) == 1 else [0, 1]
        elif shares[1] <= AT_EDGE and np.isfinite(band[1]):
            names, fixed = [self._end_name(band[1])], [1]
        if 0 not in fixed:
            if shares[0] >= 1.0 - AT_EDGE and largest < np.pi:
                names, fixed = sorted({*names, self._end_name(band[1])}), [0, 1]
            elif self._real_forbidden_at(shares[0]):
                names, fixed = [*names, "real_poles"], [0, *fixed]
        return names, fixed

    def shares_of(self, poles: Complex) -> tuple[int, Array]:
        """Kind and shares of the section nearest to two poles: a conjugate pair, or real ones."""
        if poles[0].imag == 0.0 and self.real is not None:
            low, high = self.real
            return len(self.bands), np.clip((poles.real - low) / (high - low), 0.0, 1.0)
        angle, r = abs(np.angle(poles[0])), max(abs(poles[0]), 1e-12)
        natural = float(np.hypot(angle, np.log(r)))
        distances = [max(low - natural, natural - high, 0.0) for low, high in self.bands]
        kind = int(np.argmin(distances))
        band = self.bands[kind]
        if distances[kind] > 0.0:
            # To the nearer end of the band, with the damping that the pair has.
            end = band[0] if natural < band[0] else band[1]
            angle, r = angle * end / natural, r ** (end / natural)
        largest = self.largest_angle(band)
        angle = min(angle, largest)
        edges, (low, _) = self.edges(angle, band)
        high = min(edge for edge, _ in edges.values())
        share = (r - low) / (high - low) if high > low else 0.5
        return kind, np.clip(np.array([angle / largest, share]), 0.0, 1.0)

    def active_real(self, share: float) -> str | None:
        """The constraint at whose edge a real pole lies."""
        low, high = self.real or (0.0, 0.0)
        if share >= 1.0 - AT_EDGE:
            return self.radius_name
        if share <= AT_EDGE:
            if low == 0.0:
                return "real_poles"
            return self.radius_name if low == -high else "min_damping_ratio"
        return None

    def _end_name(self, end: float) -> str:
        """The constraint that the end of a band stands for."""
        return "frequency_band" if end in self.whole_band else "forbidden_bands"

    def _real_forbidden_at(self, share: float) -> bool:
        """Whether a pair is about to become two real poles that are not allowed."""
        if share <= AT_EDGE:
            return self.real is None
        return share >= 1.0 - AT_EDGE and (self.real is None or self.real[0] >= 0.0)


def _circle(natural: float, angle: float) -> tuple[float, float]:
    """Radius of the pole of a natural frequency at an angle, and its slope."""
    decay = max(float(np.sqrt(max(natural**2 - angle**2, 0.0))), LEAST)
    radius = float(np.exp(-decay))
    return radius, radius * angle / decay
