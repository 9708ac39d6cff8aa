"""State-space models against closed forms, SciPy and python-control."""

from dataclasses import replace

import numpy as np
import pytest
from covariances import covariance_of_matrix
from scipy.signal import dlsim

from evopem.files.json_form import from_json, to_json
from evopem.models import states
from evopem.models.modes import assurance, mean_phase, phase_collinearity, plane_assurance
from evopem.models.parameter_covariance import ParameterCovariance
from evopem.models.state_space import StateSpaceModel

RATE = 50.0


def model(seed=0, n=4, nu=2, ny=3, delays=(0, 2)):
    generator = np.random.default_rng(seed)
    A = generator.standard_normal((n, n))
    A *= 0.9 / np.abs(np.linalg.eigvals(A)).max()
    return StateSpaceModel(
        A=A,
        B=generator.standard_normal((n, nu)),
        C=generator.standard_normal((ny, n)),
        D=generator.standard_normal((ny, nu)),
        K=0.1 * generator.standard_normal((n, ny)),
        sampling_rate=RATE,
        level=generator.standard_normal(ny),
        noise_covariance=np.eye(ny),
        input_delays=delays,
    )


def beam(damping=(0.01, 0.02), frequencies=(3.0, 7.0)):
    """Two modes whose poles and complex shapes are known."""
    poles, shapes = [], np.array([[1.0, 0.5 + 0.1j, -0.3], [0.4, 1.0, 0.2j]])
    for zeta, frequency in zip(damping, frequencies, strict=True):
        omega = 2.0 * np.pi * frequency
        poles.append(np.exp((-zeta + 1j * np.sqrt(1.0 - zeta**2)) * omega / RATE))
    A, C = np.zeros((4, 4)), np.zeros((3, 4))
    for k, pole in enumerate(poles):
        part = slice(2 * k, 2 * k + 2)
        A[part, part] = [[pole.real, pole.imag], [-pole.imag, pole.real]]
        C[:, part] = np.column_stack([shapes[k].real, shapes[k].imag])
    # A similarity changes nothing that can be measured.
    T = np.random.default_rng(3).standard_normal((4, 4))
    inverse = np.linalg.inv(T)
    B = np.array([[1.0], [0.0], [0.5], [0.0]])
    K = np.full((4, 3), 0.02)
    return (
        StateSpaceModel(
            A=T @ A @ inverse,
            B=T @ B,
            C=C @ inverse,
            D=np.zeros((3, 1)),
            K=T @ K,
            sampling_rate=RATE,
            level=np.zeros(3),
            noise_covariance=np.eye(3),
        ),
        np.array(poles),
        shapes,
    )


def test_the_simulation_is_that_of_scipy_with_delays_and_level():
    m = model()
    u = np.random.default_rng(1).standard_normal((60, 2))
    expected = dlsim(m.to_scipy(), u)[1] + m.level
    np.testing.assert_allclose(m.simulate(u), expected, atol=1e-12)


def test_the_frequency_response_is_that_of_python_control():
    control = pytest.importorskip("control")
    m = model()
    f = np.array([0.5, 3.0, 20.0])
    system = m.to_control()
    assert isinstance(system, control.StateSpace)
    expected = system(np.exp(2j * np.pi * f / RATE))
    np.testing.assert_allclose(m.frequency_response(f), np.moveaxis(expected, -1, 0), rtol=1e-9)
    assert m.frequency_response(3.0).shape == (3, 2)


def test_the_frequency_response_is_the_transform_of_the_impulse_response():
    m = model()
    f = np.array([1.0, 7.3])
    z = np.exp(-2j * np.pi * np.outer(f, np.arange(400)) / RATE)
    transform = np.einsum("ft,tij->fij", z, m.impulse_response(400))
    np.testing.assert_allclose(m.frequency_response(f), transform, rtol=1e-8)


def test_residuals_recover_the_innovations_and_predictions_add_up():
    m = model()
    generator = np.random.default_rng(2)
    u, e, x0 = generator.standard_normal((80, 2)), generator.standard_normal((80, 3)), np.ones(4)
    delayed = np.column_stack([u[:, 0], np.concatenate([np.zeros(2), u[:-2, 1]])])
    x, y = x0, []
    for drive, noise in zip(delayed, e, strict=True):
        y.append(m.level + m.C @ x + m.D @ drive + noise)
        x = m.A @ x + m.B @ drive + m.K @ noise
    y = np.array(y)
    np.testing.assert_allclose(m.residuals(u, y, x0), e, atol=1e-10)
    np.testing.assert_allclose(m.predict(u, y, 1, x0), y - e, atol=1e-10)
    # Two steps ahead, the last innovation is not known.
    two = m.predict(u, y, 2, x0)
    np.testing.assert_allclose(two[1:], y[1:] - e[1:] - e[:-1] @ (m.C @ m.K).T, atol=1e-10)
    # A horizon beyond the record is the simulation.
    np.testing.assert_allclose(m.predict(u, y, 500, x0), m.simulate(u, x0), atol=1e-9)


def test_states_that_fit_are_those_that_were_simulated():
    m = model()
    u, x0 = np.random.default_rng(4).standard_normal((100, 2)), np.array([1.0, -2.0, 0.5, 3.0])
    y = m.simulate(u, x0)
    np.testing.assert_allclose(m.simulate_from_fitted_state(u, y), y, atol=1e-8)
    np.testing.assert_allclose(m.prediction_state(u, y), x0, atol=1e-8)
    levelled, state = replace(m, level=np.zeros(3)).with_fitted_level(u, y)
    np.testing.assert_allclose(levelled.level, m.level, atol=1e-8)
    np.testing.assert_allclose(state, x0, atol=1e-8)


@pytest.mark.parametrize("level", [False, True])
def test_inputs_before_a_record_do_not_spoil_the_state_behind_a_delay(level):
    """The noise is far below what the inputs of the delay before the first sample do."""
    generator = np.random.default_rng(12)
    m = replace(beam()[0], input_delays=(20,), K=np.zeros((4, 3)))
    u, e = generator.standard_normal((700, 1)), generator.standard_normal((700, 3))
    u, y = u[200:], (m.simulate(u) + 1e-4 * e)[200:]
    found, state = m.with_fitted_level(u, y) if level else (m, m.prediction_state(u, y))
    np.testing.assert_allclose(found.residuals(u, y, state)[20:], 0.0, atol=6e-4)


def test_a_level_that_fits_is_the_one_that_was_added():
    m = model()
    u, x0 = np.random.default_rng(4).standard_normal((100, 2)), np.array([1.0, -2.0, 0.5, 3.0])
    change = np.linspace(1.0, 2.0, m.outputs)
    y = m.simulate(u, x0) + change
    np.testing.assert_allclose(m.simulate_from_fitted_state(u, y, fit_level=True), y, atol=1e-8)


def test_modes_have_the_poles_and_shapes_that_they_were_made_of():
    m, poles, shapes = beam()
    modes = m.modes()
    np.testing.assert_allclose([mode.frequency_hz for mode in modes], [3.0, 7.0], rtol=1e-10)
    np.testing.assert_allclose([mode.damping_ratio for mode in modes], [0.01, 0.02], rtol=1e-8)
    for mode, pole, shape in zip(modes, poles, shapes, strict=True):
        np.testing.assert_allclose(mode.pole, pole)
        # y = Re(shape q) with q turning the other way: conjugate of the upper pole's shape.
        expected = shape.conj() / shape.conj()[np.argmax(np.abs(shape))]
        found = mode.shape
        match = assurance(found, expected), assurance(found, expected.conj())
        assert max(match) == pytest.approx(1.0, abs=1e-10)
        assert found[np.argmax(np.abs(found))] == pytest.approx(1.0)


def test_the_residues_of_the_modes_add_up_to_the_frequency_response():
    m, _, _ = beam()
    f = np.array([2.0, 5.0, 9.0])
    z = np.exp(2j * np.pi * f / RATE)
    total = np.zeros((3, 3, 1), dtype=complex)
    for mode in m.modes():
        for pole, shape, drive in (
            (mode.pole, mode.shape, mode.input_participation),
            (np.conj(mode.pole), mode.shape.conj(), mode.input_participation.conj()),
        ):
            total += np.outer(shape, drive) / (z - pole)[:, None, None]
    np.testing.assert_allclose(m.frequency_response(f), total, rtol=1e-9)


def test_output_shares_add_up_to_one_where_all_poles_oscillate():
    m, _, _ = beam()
    np.testing.assert_allclose(sum(mode.output_shares for mode in m.modes()), np.ones(3))


def test_standard_errors_of_modes_agree_with_finite_differences():
    m, _, _ = beam()
    generator = np.random.default_rng(5)
    count = len(m.parameters)
    factor = 1e-3 * generator.standard_normal((count, 3))
    m = replace(m, covariance=ParameterCovariance(factor, np.empty((count, 0))))
    step = 1e-4
    slopes = []
    for direction in factor.T:
        up = m.with_parameters(m.parameters + step * direction).modes()
        down = m.with_parameters(m.parameters - step * direction).modes()
        slopes.append(
            [
                np.concatenate(
                    [
                        [a.frequency_hz - b.frequency_hz, a.damping_ratio - b.damping_ratio],
                        (a.shape - b.shape).real,
                        (a.shape - b.shape).imag,
                    ]
                )
                / (2.0 * step)
                for a, b in zip(up, down, strict=True)
            ]
        )
    expected = np.linalg.norm(np.array(slopes), axis=0)
    for mode, errors in zip(m.modes(), expected, strict=True):
        found = np.concatenate(
            [
                [mode.frequency_se_hz, mode.damping_se],
                mode.shape_se_real,
                mode.shape_se_imag,
            ]
        )
        np.testing.assert_allclose(found, errors, rtol=1e-5, atol=1e-12)


def test_phase_collinearity_and_mean_phase_of_known_shapes():
    straight = np.array([1.0, -0.5, 0.2]) * np.exp(0.5j)
    circling = np.array([1.0, 1.0j])
    assert phase_collinearity(straight) == pytest.approx(1.0)
    assert phase_collinearity(circling) == pytest.approx(0.0)
    angle, deviation = mean_phase(straight)
    assert angle == pytest.approx(np.degrees(0.5))
    assert deviation == pytest.approx(0.0, abs=1e-4)
    angle, deviation = mean_phase(np.array([np.exp(0.1j), np.exp(-0.1j)]))
    assert angle == pytest.approx(0.0, abs=1e-9)
    assert deviation == pytest.approx(np.degrees(0.1), abs=1e-4)


@pytest.mark.parametrize("inputs", [2, 0])
def test_the_json_form_gives_the_same_model_back(inputs):
    m = model(nu=inputs, delays=(0, 2)[:inputs])
    m = replace(
        m,
        covariance=ParameterCovariance(np.ones((len(m.parameters), 1)), np.empty((0, 0))),
        output_names=("a", "b", "c"),
    )
    back = from_json(StateSpaceModel, to_json(m))
    np.testing.assert_array_equal(back.parameters, m.parameters)
    assert back.B.shape == m.B.shape
    assert back.output_names == m.output_names
    assert back.input_delays == m.input_delays
    np.testing.assert_array_equal(back.covariance.factor, m.covariance.factor)


def test_a_model_without_input_simulates_its_level_and_has_no_participation():
    m = model(nu=0, delays=())
    np.testing.assert_allclose(m.simulate(np.empty((5, 0))), np.tile(m.level, (5, 1)))
    assert all(mode.input_participation.shape == (0,) for mode in m.modes())


def test_arguments_of_idss_can_be_saved_and_loaded(tmp_path):
    from scipy.io import loadmat

    from evopem.models.polynomial import save_model_mat

    m = model()
    save_model_mat(m, tmp_path / "model.mat")
    loaded = loadmat(tmp_path / "model.mat")
    for name in "ABCDK":
        np.testing.assert_array_equal(loaded[name], getattr(m, name))
    assert loaded["Ts"].item() == 1.0 / RATE
    np.testing.assert_array_equal(loaded["InputDelay"].ravel(), [0, 2])


def test_matrices_that_do_not_fit_together_are_refused():
    m = model()
    with pytest.raises(ValueError, match="C must be"):
        replace(m, C=np.ones((3, 5)))
    with pytest.raises(ValueError, match="2 inputs need 2 delays"):
        replace(m, input_delays=(1,))
    with pytest.raises(ValueError, match="2 channels need 2 names"):
        replace(m, input_names=("u",))


def close_pair(gap):
    """Two modes whose frequencies differ by a share ``gap``, at four outputs, with a covariance."""
    A, C = np.zeros((4, 4)), np.random.default_rng(4).standard_normal((4, 4))
    for k, frequency in enumerate((0.1, 0.1 * (1.0 + gap))):
        pole = np.exp((-0.02 + 1j) * 2.0 * np.pi * frequency)
        A[2 * k : 2 * k + 2, 2 * k : 2 * k + 2] = [[pole.real, pole.imag], [-pole.imag, pole.real]]
    model = StateSpaceModel(
        A=A,
        B=np.zeros((4, 0)),
        C=C,
        D=np.zeros((4, 0)),
        K=np.zeros((4, 4)),
        sampling_rate=1.0,
        level=np.zeros(4),
        noise_covariance=np.eye(4),
    )
    variances = np.concatenate([np.full(16, 1e-3**2), np.full(16, 1e-2**2), np.zeros(20)])
    return replace(model, covariance=covariance_of_matrix(np.diag(variances)))


def test_the_assurance_expected_of_a_shape_is_that_of_perturbed_models():
    m = close_pair(0.2)
    found = m.modes()
    generator = np.random.default_rng(5)
    alone, planes = np.empty((400, 2)), np.empty(400)
    for row in range(400):
        entries = m.covariance.factor @ generator.standard_normal(m.covariance.factor.shape[1])
        A = m.A + entries[:16].reshape(4, 4)
        C = m.C + entries[16:32].reshape(4, 4)
        other = replace(m, A=A, C=C, covariance=None).modes()
        alone[row] = [assurance(a.shape, b.shape) for a, b in zip(found, other, strict=True)]
        planes[row] = plane_assurance(
            *(np.column_stack([mode.shape for mode in pair]) for pair in (found, other))
        )
    for mode, expected in zip(found, alone.mean(axis=0), strict=True):
        assert 1.0 - mode.shape_assurance == pytest.approx(1.0 - expected, rel=0.15)
        assert mode.plane_assurance > mode.shape_assurance
    # Both shapes leave the plane by as much as the data allow.
    assert 1.0 - planes.mean() < sum(1.0 - mode.plane_assurance for mode in found)


def test_shapes_of_nearly_equal_poles_are_mixed_but_their_plane_is_known():
    apart, close = close_pair(0.2).modes(), close_pair(0.001).modes()
    for one, other in ((apart[0], close[0]), (apart[1], close[1])):
        assert one.equal_poles_p < 1e-6
        assert other.equal_poles_p > 0.1
        assert other.shape_assurance < 0.5 < 0.95 < one.shape_assurance
        assert other.plane_assurance > 0.99
    assert [mode.partner for mode in close] == [1, 0]


def test_plane_assurance_does_not_depend_on_the_mixture():
    generator = np.random.default_rng(6)
    shapes = generator.standard_normal((4, 2)) + 1j * generator.standard_normal((4, 2))
    mixed = shapes @ np.array([[1.0, 0.5j], [-0.3, 2.0]])
    assert plane_assurance(shapes, mixed) == pytest.approx(1.0)
    one, other = shapes[:, :1], shapes[:, 1:]
    assert plane_assurance(one, other) == pytest.approx(assurance(one[:, 0], other[:, 0]))


def test_a_state_is_fitted_to_the_samples_that_it_is_seen_in(monkeypatch):
    """Rows after it has decayed change nothing, and are not decomposed."""
    generator, rows, solve = np.random.default_rng(3), [], states._least_squares

    def counted(columns, goal):
        rows.append(len(columns))
        return solve(columns, goal)

    columns = (0.9 ** np.arange(20_000.0))[:, None, None] * np.array([1.0, -2.0])
    columns[:, :, 1] *= np.cos(np.arange(20_000.0))[:, None]
    target = generator.standard_normal((20_000, 1))
    expected = np.linalg.lstsq(columns[:, 0], target[:, 0])[0]
    monkeypatch.setattr(states, "_least_squares", counted)
    assert states.fitted(columns, target, np.ones(1)) == pytest.approx(expected, rel=1e-12)
    robust = states.fitted(columns, target, np.ones(1), robust=True)
    assert np.isfinite(robust).all()
    assert rows[0] < 500
    assert rows[1:] == [20_000] * len(rows[1:])


@pytest.mark.parametrize("samples", [0, 1, 2, 300])
@pytest.mark.parametrize("poles", ["some", "none", "none, transposed"])
def test_states_are_those_of_the_recursion(samples, poles):
    dynamics = np.array([[0.9, 0.4, 0.1], [-0.3, 0.8, 0.7], [0.2, 0.5, -0.6]])
    if poles != "some":
        dynamics = np.triu(dynamics, 1) if poles == "none" else np.triu(dynamics, 1).T
    drive = np.arange(3.0 * samples).reshape(samples, 3) % 7.0
    x, expected = np.array([1.0, -1.0, 2.0]), []
    for each in drive:
        expected.append(x)
        x = dynamics @ x + each
    found = states.states_of(dynamics, drive, np.array([1.0, -1.0, 2.0]))
    expected = np.reshape(expected, (samples, 3))
    np.testing.assert_allclose(found, expected, rtol=1e-12, atol=1e-12)


def test_states_that_decay_end_at_zero_and_those_that_grow_are_never_finite_again():
    """Subnormal numbers would take a hundred times as long as others."""
    decayed = states.states_of(np.diag([0.5, -0.6]), np.zeros((5_000, 2)), np.ones(2))
    assert np.abs(decayed[decayed != 0.0]).min() > 1e-200
    assert not decayed[-1].any()
    growing = np.array([[9.0, 9.0], [-9.0, 9.0]])
    grown = states.states_of(growing, np.zeros((999, 2)), np.ones(2))
    assert not np.isfinite(grown[-1]).any()
