"""Synthetic recordings with a known truth: an ARMAX model, and a flexible arm on a servomotor.

The arm is the stand-in for the chapter's apparatus: a continuous-time model, so that no discrete
model class is handed the answer.  A resonant servo loop carries a flexible arm in modal
coordinates, driven through the hub's angular acceleration.  The recording of the tip's acceleration
arrives through a zero-order hold, a transport delay, and a sensor whose drift and slightly
compressive characteristic make it non-stationary in mean and variance.
"""

from dataclasses import dataclass

import numpy as np
import scipy  # whose parts load on first use

from evopem.arrays import Array
from evopem.config.channels import SyntheticSource
from evopem.config.settings import TransformSettings
from evopem.models.modes import Mode
from evopem.models.orders import Orders
from evopem.models.polynomial import PolynomialModel
from evopem.models.states import states_of
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
WARM_UP = 2000  # samples before a record, for the transients to decay

# Natural frequencies (Hz) and damping ratios: the servo loop, and the arm's modes with the share
# of each in the tip's acceleration.  The frequencies are those of the chapter's spectrum and
# table 2 (2, 5.36, 37 Hz, and the broad one at 16.65 Hz); the shares are ours.
SERVO = (16.65, 0.1750)
ARM_MODES = ((2.00, 0.0150, 0.60), (5.36, 0.0091, 0.35), (37.00, 0.0107, -0.25))
ARM_LENGTH = 0.5
# Whole samples between the velocity command and the sensor's record, the hold's own one excluded.
TRANSPORT_SAMPLES = 2
# Torque disturbances act on the arm within the loop; relative to the command (rad/s).
DISTURBANCE = 0.1
# Sensor noise, and the second difference of the sensor's drift, relative to the standard deviation
# of the tip's acceleration.  The drift is a doubly summed random walk: two differences make it
# white, as the chapter's preparation presumes.
SENSOR_NOISE = 0.01
DRIFT_STEP = 0.03
# The sensor's characteristic is the inverse Box-Cox transform of this exponent, in volts.
SENSOR_GAIN = 1e-4
CHARACTERISTIC = 1.1
WARM_UP_SECONDS = 60.0
STEADY = 20  # samples for which the dynamics of an arm that softens are held


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
    model = true_model(sampling_rate)
    generator = np.random.default_rng(np.random.SeedSequence(seed, spawn_key=(1,)))
    total = samples + WARM_UP
    u = generator.standard_normal(total)
    clean = model.simulate(u)
    deviation = noise * float(np.std(clean[WARM_UP:]))
    output = clean + scipy.signal.lfilter(
        model.C, model.A, deviation * generator.standard_normal(total)
    )
    output = undo_stationarity(output[WARM_UP:], box_cox, difference)
    recording = Recording(u[WARM_UP:], output, sampling_rate)
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
    for _ in range(difference):
        signal = np.cumsum(signal)
    if box_cox is None:
        return signal
    return scipy.special.inv_boxcox(signal - signal.min() + np.std(signal), box_cox)


def flexible_arm(
    seed: int, samples: int, sampling_rate: float = 100.0, softening: float = 0.0
) -> tuple[Recording, Truth]:
    """White velocity commands in, tip acceleration out; modes must lie below half the rate (Hz).

    ``softening``: share by which the frequencies of the arm, not of the servo loop, fall along the
    recording as its payload grows; the modes of the truth are those at its start.

    >>> recording, truth = flexible_arm(seed=1, samples=500)
    >>> [mode.frequency_hz for mode in truth.modes]
    [2.0, 5.36, 16.65, 37.0]
    """
    generator = np.random.default_rng(np.random.SeedSequence(seed, spawn_key=(0,)))
    warm_up = int(WARM_UP_SECONDS * sampling_rate)
    total = samples + warm_up + TRANSPORT_SAMPLES
    command = generator.standard_normal(total)
    disturbance = DISTURBANCE * generator.standard_normal(total)

    loads = np.clip((np.arange(total) - warm_up) / samples, 0.0, 1.0)
    held = STEADY if softening else total
    parts: list[Array] = []
    state = None
    for first in range(0, total, held):
        a, b, c = arm_dynamics(1.0 - softening * float(loads[first]))
        # Zero-order hold of both inputs over a sampling interval, exactly.
        continuous = a, b, c[None, :], np.zeros((1, 2))
        transition, drive, *_ = scipy.signal.cont2discrete(continuous, 1.0 / sampling_rate)
        signals = np.column_stack([command, disturbance])[first : first + held]
        states = states_of(transition, signals @ drive.T, state)
        state = transition @ states[-1] + drive @ signals[-1]
        parts.append(states @ c)
    acceleration = np.concatenate(parts)
    delayed = acceleration[warm_up - TRANSPORT_SAMPLES : warm_up - TRANSPORT_SAMPLES + samples]
    spread = float(np.std(delayed))
    noise = SENSOR_NOISE * spread * generator.standard_normal(samples)
    drift = np.cumsum(np.cumsum(DRIFT_STEP * spread * generator.standard_normal(samples)))
    measured = delayed + drift + noise
    volts = scipy.special.inv_boxcox(
        SENSOR_GAIN * (measured - measured.min() + spread), CHARACTERISTIC
    )
    recording = Recording(
        inputs=command[warm_up : warm_up + samples],
        outputs=volts,
        sampling_rate=sampling_rate,
        input_names=("motor velocity",),
        output_names=("tip acceleration",),
        input_units=("rad/s",),
        output_units=("V",),
    )
    modes = sorted([SERVO, *((f, z) for f, z, _ in ARM_MODES)])
    truth = Truth(
        kind="flexible_arm",
        seed=seed,
        delay_samples=TRANSPORT_SAMPLES + 1,
        modes=tuple(true_mode(f, z, sampling_rate) for f, z in modes),
        noise={
            "torque_disturbance_ratio": DISTURBANCE,
            "sensor_noise_ratio": SENSOR_NOISE,
            "drift_step_ratio": DRIFT_STEP,
        },
        box_cox=CHARACTERISTIC,
        difference=2,
        last_hz=tuple(f if (f, z) == SERVO else f * (1.0 - softening) for f, z in modes)
        if softening
        else (),
    )
    return recording, truth


def arm_dynamics(factor: float = 1.0) -> tuple[Array, Array, Array]:
    """Matrices A, B, C of ``x' = A x + B [command, torque]``, tip acceleration ``C x``.

    States: hub velocity and its derivative (servo loop), then displacement and velocity of each arm
    mode, driven by minus the hub's angular acceleration.  ``factor``: of their frequencies.
    """
    w, damping = 2.0 * np.pi * SERVO[0], SERVO[1]
    states = 2 + 2 * len(ARM_MODES)
    a, b, c = np.zeros((states, states)), np.zeros((states, 2)), np.zeros(states)
    # Hub velocity v: v'' + 2 zeta w v' + w^2 v = w^2 (command + torque), so hub acceleration = x_1.
    a[0, 1] = 1.0
    a[1, :2] = -(w**2), -2.0 * damping * w
    b[1, :] = w**2
    c[1] = ARM_LENGTH
    for index, (frequency, ratio, share) in enumerate(ARM_MODES):
        row = 2 + 2 * index
        wm = 2.0 * np.pi * frequency * factor
        a[row, row + 1] = 1.0
        a[row + 1, row : row + 2] = -(wm**2), -2.0 * ratio * wm
        a[row + 1, 1] = -1.0
        c += share * a[row + 1]
    return a, b, c


def synthesize(source: SyntheticSource, transforms: TransformSettings) -> tuple[Recording, Truth]:
    """Simulate a recording of a known system.

    An ARMAX recording is made non-stationary in the way that the transforms undo.

    >>> source = SyntheticSource("armax", seed=1, samples=1000)
    >>> recording, truth = synthesize(source, TransformSettings(box_cox="none", difference=0))
    >>> recording.output.shape
    (1000,)
    """
    length = source.seed, source.samples, source.sampling_rate
    if source.synthesis == "flexible_arm":
        return flexible_arm(*length, source.softening or 0.0)
    noise = 0.1 if source.noise is None else source.noise
    box_cox = None if isinstance(transforms.box_cox, str) else transforms.box_cox
    return armax(*length, noise, box_cox, transforms.difference)
