"""Modes of set-ups with common channels: against the structure that their models were made from."""

from dataclasses import replace

import numpy as np
import pytest

from evopem.errors import InputError
from evopem.models.merged_modes import merge_setups
from evopem.models.modes import assurance
from evopem.models.parameter_covariance import ParameterCovariance
from evopem.models.setups import Setup
from evopem.models.state_space import StateSpaceModel

RATE, PIVOT = 50.0, 3
FREQUENCIES, DAMPINGS = np.array([3.0, 3.4, 8.0]), np.array([0.02, 0.01, 0.015])
SHAPES = np.random.default_rng(3).standard_normal((6, 3))
SHAPES[PIVOT] = 3.0
ROVING_SENSORS = {"a": ([0, 1, 2], ()), "b": ([0, 1, 3], ()), "c": ([1, 2, 4, 5], ())}
ROVING_HAMMER = {"a": ([0, 3], (0, 1)), "b": ([0, 3], (1, 2)), "c": ([3, 4], (3,))}
COMMON_FORCE = {"a": ([0, 1], (2,)), "b": ([3, 5], (2,)), "c": ([4], (2, 1))}


def model(outputs, inputs, stiffness=1.0, gain=1.0, rate=RATE, delay=0):
    """The model of the structure at some points, forces held between samples; states at random."""
    from scipy.signal import cont2discrete

    A, B = np.zeros((6, 6)), np.zeros((6, len(inputs)))
    for k, (f, z) in enumerate(zip(FREQUENCIES * np.sqrt(stiffness), DAMPINGS, strict=True)):
        w = 2 * np.pi * f
        A[2 * k : 2 * k + 2, 2 * k : 2 * k + 2] = [[0, 1], [-(w**2), -2 * z * w]]
        B[2 * k + 1] = SHAPES[list(inputs), k]
    C = np.zeros((len(outputs), 6))
    C[:, 1::2] = gain * SHAPES[outputs]
    A, B, *_ = cont2discrete((A, B, C, np.zeros((len(C), len(inputs)))), 1 / rate)
    T = np.random.default_rng(len(outputs)).standard_normal((6, 6)) + 3 * np.eye(6)
    B = np.linalg.matrix_power(A, delay) @ B  # the same response from its delay on
    l = len(C)  # noqa: E741
    return StateSpaceModel(
        *(np.linalg.solve(T, A @ T), np.linalg.solve(T, B), C @ T, np.zeros((l, len(inputs)))),
        *(np.zeros((6, l)), rate, np.zeros(l), np.eye(l), (delay,) * len(inputs)),
        input_names=tuple(f"f{k}" for k in inputs),
        output_names=tuple(f"y{k}" for k in outputs),
    )


def uncertain(exact, generator, size=0.3):
    """A model whose entries have errors of a known covariance, each set-up with its own."""
    entries, n = exact.parameters, exact.A.size
    factor = np.diag(size * np.where(np.arange(len(entries)) < n, 2e-6, 3e-3) * np.abs(entries))
    factor @= np.linalg.qr(generator.standard_normal(factor.shape))[0]
    factor[:n] += 1e-6 * generator.standard_normal((n, len(entries)))
    changed = exact.with_parameters(entries + factor @ generator.standard_normal(len(entries)))
    return replace(changed, covariance=ParameterCovariance(factor, np.empty((len(entries), 0))))


def merged(layout, generator, **changes):
    return merge_setups(
        [
            Setup.of(name, uncertain(model(*channels, **changes.get(name, {})), generator))
            for name, channels in layout.items()
        ]
    )


def deviations(found):
    """Values of frequency, damping, shape and drives less those of the structure, in errors."""
    apart = []
    for k, mode in enumerate(found.modes):
        shape = SHAPES[[int(name[1:]) for name in found.outputs], k]
        scale = shape[np.argmin(mode.shape_se_real)]
        apart += [(mode.frequency_hz - FREQUENCIES[k]) / mode.frequency_se_hz]
        apart += [(mode.damping_ratio - DAMPINGS[k]) / mode.damping_se]
        others = mode.shape_se_real > 0.0
        apart += list((mode.shape - shape / scale).real[others] / mode.shape_se_real[others])
        apart += list(mode.shape.imag[others] / mode.shape_se_imag[others])
        # Velocities C v w' B of the pole s = -zw + i w sqrt(1 - z^2): phi phi' s / (s - s*).
        z, points = DAMPINGS[k], [int(name[1:]) for name in found.inputs]
        half = 0.5 * (1.0 + 1j * z / np.sqrt(1.0 - z**2))
        drives = mode.input_participation - half * scale * SHAPES[points, k]
        apart += list(drives.real / found.drive_errors[k].real)
        apart += list(drives.imag / found.drive_errors[k].imag)
    return apart


@pytest.mark.parametrize("layout", [ROVING_SENSORS, ROVING_HAMMER, COMMON_FORCE])
def test_errors_of_everything_merged_are_those_of_repeated_records(layout):
    """Gains, rates and delays differ between set-ups; the errors' covariance is given."""
    generator, apart, named = np.random.default_rng(1), [], 0
    changes = {"b": {"gain": 7.0}} if layout is ROVING_SENSORS else {"b": {"delay": 2}}
    changes["c"] = {"rate": 60.0}
    for _ in range(40):
        found = merged(layout, generator, **changes)
        assert len(found.modes) == 3
        apart.append(deviations(found))
        named += bool(found.contradictions)
    assert np.isfinite(apart).all()
    assert 0.92 < np.mean(np.abs(apart) < 1.96) < 0.98
    assert np.abs(np.mean(apart, axis=0)).max() < 4.0 / np.sqrt(len(apart))
    assert named <= 7  # 2 are expected


def test_common_channels_make_each_mode_better_known():
    found = merged(ROVING_SENSORS, np.random.default_rng(2))
    for mode, by_setup in zip(found.modes, found.by_setup, strict=True):
        weights = sum(each.frequency_se_hz**-2 for each in by_setup)
        assert mode.frequency_se_hz <= 1.001 * weights**-0.5
        true = SHAPES[[int(name[1:]) for name in found.outputs], found.modes.index(mode)]
        assert assurance(mode.shape, true.astype(complex)) > 0.99


@pytest.mark.parametrize(
    ("change", "quantity"),
    [
        ({"stiffness": 1.03}, "frequency"),
        ({"gain": np.array([[1], [1], [-1], [1]])}, "shape at y2"),
    ],
)
def test_a_set_up_that_contradicts_the_others_is_named(change, quantity):
    layout = ROVING_SENSORS | {"d": ([0, 1, 2, 3], ())}
    found = merged(layout, np.random.default_rng(4), d=change)
    (named,) = found.contradictions
    assert named.setup == "d"
    assert quantity in named.quantity
    assert named.p_value < 1e-6
    assert abs(named.standard_errors) > 5.0
    # The others decide, as far as they can.
    assert found.modes[0].frequency_hz == pytest.approx(FREQUENCIES[0], rel=2e-3)


def test_of_two_set_ups_each_contradicts_the_other():
    layout = {"a": ([0, 1, 2], ()), "b": ([0, 1, 3], ())}
    found = merged(layout, np.random.default_rng(5), b={"stiffness": 0.96})
    assert {named.setup for named in found.contradictions} == {"a", "b"}


def test_errors_are_enlarged_by_what_set_ups_differ_in_errors_of_both():
    """In those of the better one alone they would be enlarged six times."""
    generator = np.random.default_rng(9)
    given = [
        Setup.of("a", uncertain(model([0, 1, 2], ()), generator)),
        Setup.of("b", uncertain(model([0, 1, 3], (), stiffness=1.0005), generator, size=3.0)),
    ]
    found = merge_setups(given)
    assert [named.setup for named in found.contradictions] == ["a", "b"]
    # What differs most is stated beside the other set-up, not beside the mean of both.
    most = [abs(named.standard_errors) for named in found.contradictions]
    assert min(most) > 3.0
    assert max(most) < 6.0
    for mode, by_setup in zip(found.modes, found.by_setup, strict=True):
        weighed = sum(each.frequency_se_hz**-2 for each in by_setup) ** -0.5
        assert mode.frequency_se_hz < 3.0 * weighed


def test_a_mode_that_a_set_up_lacks_has_no_shape_there():
    generator = np.random.default_rng(6)
    given = [
        Setup.of(name, uncertain(model(*channels), generator))
        for name, channels in ROVING_SENSORS.items()
    ]
    last = Setup.of("c", uncertain(model(*ROVING_SENSORS["c"]), generator), given[2].modes[1:])
    found = merge_setups([*given[:2], replace(last)])
    assert found.by_setup[0][2] is None
    assert np.isnan(found.modes[0].shape).tolist() == [
        name in ("y4", "y5") for name in found.outputs
    ]
    assert np.isfinite(found.modes[1].shape).all()


@pytest.mark.parametrize(
    ("layout", "sentence"),
    [
        ({"a": ([0, 1], ())}, "set-ups: there are fewer than two; give those of one structure."),
        (
            {"a": ([0, 1], ()), "b": ([1, 2], ()), "c": ([4, 5], ())},
            "c: it has no channel in common with the others, through which its shapes are scaled;"
            " give common channels the same names, or leave it out.",
        ),
    ],
)
def test_what_cannot_be_merged_is_said_in_a_sentence(layout, sentence):
    with pytest.raises(InputError) as raised:
        merged(layout, np.random.default_rng(7))
    assert str(raised.value) == sentence


def test_a_model_without_errors_or_names_is_refused():
    exact = model([0, 1], ())
    with pytest.raises(InputError, match="no state-space model with a covariance"):
        Setup.of("a", exact)
    nameless = replace(uncertain(exact, np.random.default_rng(8)), output_names=())
    with pytest.raises(InputError, match="its channels have no names"):
        Setup.of("a", nameless)
