"""Records of polynomial models with known parameters, and the chapter's ARMAX model."""

from dataclasses import dataclass

import numpy as np

from evopem.arrays import Array
from evopem.models.modes import Mode
from evopem.models.orders import Orders
from evopem.models.polynomial import PolynomialModel
from evopem.signals.recording import Recording

# The modes of the chapter's table 2 (Hz, damping ratio) at its sampling rate, and one real pole.
MODES = ((5.36, 0.0091), (16.65, 0.1750), (37.00, 0.0107))
REAL_POLE = 0.5
DELAY = 3
# The chapter prints neither B nor C.  These roots are ours: distinct from the poles and from each
# other, so that every order is identifiable.
INPUT_ZEROS = (0.99, 0.70 + 0.55j, 0.70 - 0.55j, -0.20 + 0.85j, -0.20 - 0.85j)
INPUT_GAIN = 0.5
NOISE_ZEROS = (
    *(0.85 + 0.30j, 0.85 - 0.30j, 0.20 + 0.70j, 0.20 - 0.70j),
    *(-0.55 + 0.60j, -0.55 - 0.60j, 0.30),
)
# Samples before a record, for the transients to decay.
WARM_UP = 2000


@dataclass(frozen=True, eq=False)
class Truth:
    """What a synthetic recording was made from."""

    kind: str  # flexible_arm or armax
    seed: int
    delay_samples: int  # from input to output
    modes: tuple[Mode, ...]
    noise: dict[str, float]  # levels of the disturbances, by their names
    box_cox: float | None  # the transform and the differences that the output was made for
    difference: int
    orders: Orders | None = None  # of an ARMAX model, and its coefficients
    a: Array | None = None
    b: Array | None = None
    c: Array | None = None
    # Frequencies (Hz) towards which the modes move evenly until the end; empty where they stay
    last_hz: tuple[float, ...] = ()


def true_mode(frequency: float, damping_ratio: float, sampling_rate: float) -> Mode:
    """A mode of known natural frequency (Hz) and damping ratio, at a sampling rate in Hz."""
    omega = 2.0 * np.pi * frequency
    s = omega * complex(-damping_ratio, np.sqrt(1.0 - damping_ratio**2))
    return Mode(frequency, damping_ratio, complex(np.exp(s / sampling_rate)))


def true_model(sampling_rate: float = 100.0) -> PolynomialModel:
    """ARMAX(7,6,7,3) with the poles of the chapter's table 2; noise variance not set.

    >>> print(true_model().orders)
    ARMAX(7,6,7,3)
    """
    upper = [true_mode(frequency, damping, sampling_rate).pole for frequency, damping in MODES]
    poles = np.concatenate([upper, np.conj(upper), [REAL_POLE]])
    return PolynomialModel(
        A=np.real(np.poly(poles)),
        B=INPUT_GAIN * np.real(np.poly(INPUT_ZEROS)),
        C=np.real(np.poly(NOISE_ZEROS)),
        nk=DELAY,
        sampling_rate=sampling_rate,
    )


def armax(
    seed: int,
    samples: int,
    sampling_rate: float = 100.0,
    noise: float = 0.1,
    box_cox: float | None = None,
    difference: int = 0,
) -> tuple[Recording, Truth]:
    """White noise through the true model, with ARMAX noise, made non-stationary on request.

    ``noise`` is the standard deviation of the innovations over that of the noise-free output.  The
    output is summed ``difference`` times and put through the inverse Box-Cox transform, so that a
    preparation with the same values gives the ARMAX recording back.
    """
    from scipy.signal import lfilter

    model = true_model(sampling_rate)
    generator = np.random.default_rng(np.random.SeedSequence(seed, spawn_key=(1,)))
    total = samples + WARM_UP
    u = generator.standard_normal(total)
    clean = model.simulate(u)
    deviation = noise * float(np.std(clean[WARM_UP:]))
    output = clean + lfilter(model.C, model.A, deviation * generator.standard_normal(total))
    output = undo_stationarity(output[WARM_UP:], box_cox, difference)
    recording = Recording(
        inputs=u[WARM_UP:],
        outputs=output,
        sampling_rate=sampling_rate,
        input_names=("input",),
        output_names=("output",),
    )
    truth = Truth(
        kind="armax",
        seed=seed,
        delay_samples=model.orders.single.nk,
        modes=tuple(model.modes()),
        noise={"ratio": noise, "innovation_variance": deviation**2},
        box_cox=box_cox,
        difference=difference,
        orders=model.orders,
        a=model.A,
        b=model.B[0],
        c=model.C,
    )
    return recording, truth


def undo_stationarity(signal: Array, box_cox: float | None, difference: int) -> Array:
    """Sum a signal, lift it above zero and transform it; Box-Cox and differencing bring it back."""
    from scipy.special import inv_boxcox

    summed = signal
    for _ in range(difference):
        summed = np.cumsum(summed)
    if box_cox is None:
        return summed
    return inv_boxcox(summed - summed.min() + np.std(summed), box_cox)
