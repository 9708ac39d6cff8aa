"""A flexible arm on a servomotor: the synthetic stand-in for the chapter's apparatus.

A continuous-time model, so that no discrete model class is handed the answer: a resonant servo loop
carries a flexible arm in modal coordinates, driven through the hub's angular acceleration.  The
recording of the tip's acceleration arrives through a zero-order hold, a transport delay, and a
sensor whose drift and slightly compressive characteristic make it non-stationary in mean and
variance.
"""

import numpy as np

from evopem.arrays import Array
from evopem.models.states import states_of
from evopem.signals.recording import Recording
from evopem.synthesis.armax import Truth, true_mode

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
# Samples for which the dynamics of an arm that softens are held.
STEADY = 20


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
    from scipy.signal import cont2discrete
    from scipy.special import inv_boxcox

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
        transition, drive, *_ = cont2discrete(continuous, 1.0 / sampling_rate)
        signals = np.column_stack([command, disturbance])[first : first + held]
        states = states_of(transition, signals @ drive.T, state)
        state = transition @ states[-1] + drive @ signals[-1]
        parts.append(states @ c)
    acceleration = np.concatenate(parts)
    record = slice(warm_up, warm_up + samples)
    delayed = acceleration[warm_up - TRANSPORT_SAMPLES : warm_up - TRANSPORT_SAMPLES + samples]
    spread = float(np.std(delayed))
    noise = SENSOR_NOISE * spread * generator.standard_normal(samples)
    drift = np.cumsum(np.cumsum(DRIFT_STEP * spread * generator.standard_normal(samples)))
    measured = delayed + drift + noise
    volts = inv_boxcox(SENSOR_GAIN * (measured - measured.min() + spread), CHARACTERISTIC)
    recording = Recording(
        inputs=command[record],
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
