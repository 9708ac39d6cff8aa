"""Models in continuous time against the closed forms of SciPy and python-control."""

from dataclasses import replace
from itertools import product

import numpy as np
import pytest
from scipy.linalg import block_diag
from scipy.signal import cont2discrete, tf2zpk

from evopem import InputError, PolynomialModel, StateSpaceModel
from evopem.models.parameter_covariance import ParameterCovariance
from evopem.models.polynomial import model_of

HOLDS = {"zero-order": "zoh", "first-order": "foh"}
RATE = 20.0
# The system of Rao & Garnier: K (-T s + 1) / ((s^2/w1^2 + ...)(s^2/w2^2 + ...)).
NUM = np.array([-6400.0, 1600.0])
DEN = np.array([1.0, 5.0, 408.0, 416.0, 1600.0])


def sampled(num, den, rate, hold="zero-order", nk=1):
    """The polynomial model of a transfer function at samples."""
    above, below, _ = cont2discrete((num, den), 1.0 / rate, method=HOLDS[hold])
    above = np.ravel(above)
    first = 0 if hold == "first-order" else len(above) - len(np.trim_zeros(above, "f"))
    return PolynomialModel(
        np.ones(1), above[first:], F=below, nk=first + nk - 1, sampling_rate=rate
    )


def state_space(model, delays=(), covariance=None):
    A, B, C, D = model
    return StateSpaceModel(
        *(A, B, C, D, np.zeros((len(A), len(C)))),
        sampling_rate=RATE,
        level=np.zeros(len(C)),
        noise_covariance=np.eye(len(C)),
        input_delays=delays,
        structure="ss_oe",
        covariance=covariance,
    )


def random_system(seed, n=5, nu=2, ny=2):
    generator = np.random.default_rng(seed)
    A = 4.0 * generator.standard_normal((n, n))
    A -= (np.linalg.eigvals(A).real.max() + 0.5) * np.eye(n)
    parts = [generator.standard_normal(shape) for shape in ((n, nu), (ny, n), (ny, nu))]
    return A, *parts


@pytest.mark.parametrize("hold", HOLDS)
@pytest.mark.parametrize("seed", range(4))
def test_state_space_both_ways_as_scipy_samples_it(hold, seed):
    system = random_system(seed)
    *theirs, _ = cont2discrete(system, 1.0 / RATE, method=HOLDS[hold])
    back = state_space(theirs, (2, 0)).to_continuous(hold)
    for part, mine in zip(system, (back.A, back.B, back.C, back.D), strict=True):
        assert np.allclose(mine, part, rtol=1e-8, atol=1e-8)
    assert np.allclose(back.delays, [2 / RATE, 0.0])
    again = cont2discrete((back.A, back.B, back.C, back.D), 1.0 / RATE, method=HOLDS[hold])[:4]
    for mine, part in zip(again, theirs, strict=True):
        assert np.allclose(mine, part, rtol=1e-8, atol=1e-10)


@pytest.mark.parametrize("hold", HOLDS)
def test_both_ways_as_python_control_samples_it(hold):
    control = pytest.importorskip("control")
    system = random_system(7, n=3, nu=1, ny=1)
    theirs = control.ss(*system).sample(1.0 / RATE, method=HOLDS[hold])
    back = state_space((theirs.A, theirs.B, theirs.C, theirs.D)).to_continuous(hold)
    w = np.array([0.3, 1.0, 7.0])
    expected = control.ss(*system)(1j * w)
    assert np.allclose(back.frequency_response(w / (2 * np.pi))[:, 0, 0], expected, rtol=1e-9)
    assert np.allclose(back.to_control()(1j * w), expected, rtol=1e-9)
    assert np.allclose(back.to_scipy().to_tf().den, control.ss2tf(back.to_control()).den[0][0])


@pytest.mark.parametrize("hold", HOLDS)
@pytest.mark.parametrize("rate", [20.0, 100.0])
def test_transfer_function_of_a_sampled_one(hold, rate):
    model = sampled(NUM, DEN, rate, hold, nk=4 if hold == "zero-order" else 1)
    path = model.to_continuous(hold).transfer_function()
    # Rounding of the sampled coefficients, which fast sampling raises.
    assert np.allclose(path.den, DEN, rtol=1e-5)
    assert np.allclose(path.num[-2:], NUM, rtol=1e-5)
    assert np.abs(path.num[:3]).max() < 1e-3
    assert np.isclose(path.delay, 3 / rate if hold == "zero-order" else 0.0)
    poles, zeros = np.roots(DEN), tf2zpk(NUM, DEN)[0]
    found = model.to_continuous(hold).poles()
    assert np.allclose(np.sort_complex(found), np.sort_complex(poles), rtol=1e-6)
    assert np.min(np.abs(path.zeros() - zeros[0])) < 1e-6


def test_structures_and_several_inputs():
    one = np.ones(1)
    first, second = sampled([2.0], [1.0, 0.7], RATE), sampled([3.0, 1.0], [1.0, 2.0, 9.0], RATE)
    oe = PolynomialModel(
        one,
        (first.B[0], second.B[0]),
        F=(first.F[0], second.F[0]),
        nk=(3, 1),
        sampling_rate=RATE,
    )
    shared = np.convolve(first.F[0], second.F[0])
    arx = PolynomialModel(
        shared,
        (np.convolve(first.B[0], second.F[0]), np.convolve(second.B[0], first.F[0])),
        nk=(3, 1),
        sampling_rate=RATE,
    )
    both = PolynomialModel(
        first.F[0], (first.B[0], second.B[0]), F=(one, second.F[0]), nk=1, sampling_rate=RATE
    )
    s = 2j * np.pi * np.array([0.01, 0.3, 2.0])
    paths = [2.0 / (s + 0.7) * np.exp(-s * 2 / RATE), (3 * s + 1) / (s**2 + 2 * s + 9)]
    for model in (oe, arx):
        response = model.to_continuous().frequency_response(s.imag / (2 * np.pi))[:, 0]
        assert np.allclose(response, np.transpose(paths), rtol=1e-9)
        assert np.isclose(model.to_continuous().static_gain(0, 1)[0], 1 / 9)
    mixed = both.to_continuous()
    assert len(mixed.A) == 3
    again = cont2discrete((mixed.A, mixed.B, mixed.C, mixed.D), 1.0 / RATE)[:4]
    expected = both.frequency_response([0.1, 3.0])
    assert np.allclose(state_space(again).frequency_response([0.1, 3.0]), expected, rtol=1e-9)
    assert [len(mixed.transfer_function(0, place).den) - 1 for place in range(2)] == [1, 3]


def derivatives(model, hold, function):
    """Central differences of functions of a converted model by its parameters."""
    parameters, columns = model.parameters, []
    for place in range(len(parameters)):
        ends = []
        for sign in (1.0, -1.0):
            moved = parameters.copy()
            moved[place] += sign * 1e-6 * max(abs(parameters[place]), 0.1)
            if isinstance(model, StateSpaceModel):
                changed = replace(model.with_parameters(moved), covariance=None)
            else:
                changed = model_of(model.orders, moved, sampling_rate=model.sampling_rate)
            ends.append(function(changed.to_continuous(hold)))
        columns.append((ends[0] - ends[1]) / (2e-6 * max(abs(parameters[place]), 0.1)))
    return np.array(columns).T


def values(model):
    path = model.transfer_function()
    listed = [quantity.value for quantity in model.quantities()]
    return np.concatenate([path.num, path.den[1:], listed])


@pytest.mark.parametrize(
    ("kind", "hold"),
    [*product(["oe", "arx", "state space"], HOLDS)],
)
def test_covariance_is_carried_over(kind, hold):
    base = sampled([3.0, 4.0], np.poly([-0.8, -1.0 + 3j, -1.0 - 3j]), RATE, hold)
    if kind == "arx":
        base = replace(base, A=base.F[0], F=(np.ones(1),))
    if kind == "state space":
        base = state_space(cont2discrete(random_system(1, 4, 1, 1), 1 / RATE)[:4])
        base = replace(base, A=np.diag([0.9, 0.8, 0.7, 0.6]) + 0.01 * base.A)
    size = base.parameters.size
    root = 1e-3 * np.random.default_rng(5).standard_normal((size, size)) / np.sqrt(size)
    model = replace(base, covariance=ParameterCovariance(root, np.zeros((size, 0))))
    found = model.to_continuous(hold)
    path, listed = found.transfer_function(), found.quantities()
    jacobian = derivatives(model, hold, values)
    expected = np.linalg.norm(jacobian @ root, axis=1)
    errors = np.concatenate(
        [path.standard_errors(), [quantity.standard_error for quantity in listed]]
    )
    assert np.allclose(errors, expected, rtol=2e-4, atol=1e-7 * expected.max())


def test_what_the_data_do_not_determine_stays_infinite():
    model = sampled([3.0, 4.0], [1.0, 2.0, 9.0], RATE)
    null_space = np.eye(4)[:, :1]
    covariance = ParameterCovariance(1e-3 * np.eye(4)[:, 1:], null_space)
    path = replace(model, covariance=covariance).to_continuous()
    assert np.isinf(path.static_gain()[1])
    named = {quantity.name: quantity.standard_error for quantity in path.quantities()}
    assert np.isfinite(named["natural frequency"])
    assert np.isinf(path.transfer_function().standard_errors()[1])


def test_relative_degree_is_tested_and_enforced():
    model = sampled([9.0], [1.0, 2.0, 9.0], 10.0)
    generator = np.random.default_rng(0)
    root = 1e-3 * generator.standard_normal((4, 4))
    covariance = ParameterCovariance(root, np.zeros((4, 0)))
    ones = accepted = 0
    for _ in range(100):
        moved = model.parameters + root @ generator.standard_normal(4)
        estimate = model_of(model.orders, moved, sampling_rate=10.0, covariance=covariance)
        path = estimate.to_continuous().transfer_function()
        assert path.relative_degree_p(1) == 1.0
        accepted += path.relative_degree == 2
        left = path.with_relative_degree(2)
        assert left.num[1] == 0.0
        ones += np.all(left.standard_errors()[2:] <= path.standard_errors()[2:] * (1 + 1e-9))
    # 95 % within three standard deviations of 100 trials.
    assert accepted > 95 - 6.6
    assert ones == 100
    other = sampled([2.0, 9.0], [1.0, 2.0, 9.0], 10.0)
    other = replace(other, covariance=covariance).to_continuous().transfer_function()
    assert other.relative_degree == 1


@pytest.mark.parametrize(
    ("model", "problem"),
    [
        (PolynomialModel([1.0, 0.5], [1.0], nk=1), "a real pole at z = -0.5"),
        (PolynomialModel([1.0, -0.5], [1.0, 0.2, 0.3], nk=1), "a pole at z = 0"),
        (PolynomialModel([1.0, -0.5], [1.0, 0.9], nk=1), "its delay is no multiple"),
        (PolynomialModel([1.0], [1.0, 0.5, 0.2], nk=1), "a response of finite length"),
        (PolynomialModel([1.0, -0.5], ()), "no plant"),
    ],
)
def test_what_has_no_continuous_counterpart_is_said(model, problem):
    with pytest.raises(InputError, match=problem):
        model.to_continuous()


def test_of_noise_nothing_is_carried_over():
    A, B, C, D = cont2discrete(random_system(2, 3, 1, 1), 1 / RATE)[:4]
    model = state_space((block_diag(A, -0.5), np.vstack([B, [[0.0]]]), np.hstack([C, [[1.0]]]), D))
    assert len(model.to_continuous().A) == 3
