"""Models written for MATLAB, read back by SciPy and Octave."""

import shutil
import subprocess

import numpy as np
import pytest
from covariances import covariance_of_matrix
from scipy.io import loadmat

import evopem
from evopem.errors import InputError
from evopem.files.json_form import save
from evopem.models.parameter_covariance import ParameterCovariance
from evopem.models.polynomial import save_model_mat
from evopem.synthesis import true_model


@pytest.fixture
def model():
    truth = true_model()
    n = truth.orders.parameters
    covariance = ParameterCovariance(1e-2 * np.eye(n)[:, 1:], np.eye(n)[:, :1])
    return evopem.PolynomialModel(
        truth.A,
        truth.B[0],
        truth.C,
        nk=truth.nk,
        sampling_rate=100.0,
        noise_variance=0.25,
        covariance=covariance,
    )


def test_mat_holds_the_arguments_of_idpoly(model, tmp_path):
    path = tmp_path / "model.mat"
    save_model_mat(model, path)
    stored = loadmat(path)
    np.testing.assert_array_equal(stored["A"], model.A[None, :])
    np.testing.assert_array_equal(stored["B"][0], np.r_[0, 0, 0, model.B[0]])
    np.testing.assert_array_equal(stored["C"], model.C[None, :])
    assert stored["Ts"][0, 0] == 0.01
    assert stored["NoiseVariance"][0, 0] == 0.25


def test_mat_bytes_depend_on_the_model_alone(model, tmp_path):
    first, second = tmp_path / "one.mat", tmp_path / "two.mat"
    save_model_mat(model, first)
    save_model_mat(model, second)
    assert first.read_bytes() == second.read_bytes()
    assert b"evopem" in first.read_bytes()[:116]


# As blocks of a simulation do: transfer functions, or states behind delays; then the level.
BLOCKS = """
load model.mat; u = load('u.txt');
if exist('K')
  for i = 1:columns(u), u(:, i) = [zeros(InputDelay(i), 1); u(1:end-InputDelay(i), i)]; end
  x = zeros(rows(A), 1);
  for t = 1:rows(u), y(t, :) = C * x + D * u(t, :)'; x = A * x + B * u(t, :)'; end
else
  if !iscell(B), B = {B}; F = {F}; end
  y = 0; for i = 1:columns(u), y = y + filter(B{i}, conv(A, F{i}), u(:, i)); end
end
printf('%.17g\\n', (y + Level')', Ts);
"""


@pytest.mark.parametrize("structure", ["armax", "bj", "ss"])
def test_octave_simulates_the_same(model, structure, tmp_path):
    octave = shutil.which("octave-cli") or shutil.which("octave")
    if octave is None:
        pytest.skip("Octave is not installed")
    generator, one = np.random.default_rng(1), np.ones(1)
    if structure == "bj":
        B, F = ([1.0, 0.5], [0.3]), ([1.0, -1.2, 0.8], [1.0, -0.4])
        model = evopem.PolynomialModel(
            one, B, [1.0, 0.3], [1.0, -0.7], F, nk=(2, 0), sampling_rate=100.0, level=0.25
        )
    if structure == "ss":
        A, sizes = 0.9 * np.linalg.qr(generator.standard_normal((4, 4)))[0], ((4, 2), (3, 4))
        parts = [generator.standard_normal(size) for size in (*sizes, (3, 2), (4, 3))]
        level, delays = generator.standard_normal(3), (3, 0)
        model = evopem.StateSpaceModel(A, *parts, 100.0, level, np.eye(3), delays)
    save_model_mat(model, tmp_path / "model.mat")
    u = generator.standard_normal((50, model.inputs))
    np.savetxt(tmp_path / "u.txt", u, fmt="%.17g")
    printed = subprocess.run(
        [octave, "--no-gui", "--quiet", "--eval", BLOCKS],
        cwd=tmp_path,
        capture_output=True,
        text=True,
        check=True,
        timeout=120,
    ).stdout.split()
    expected = model.simulate(u).ravel()
    scale = np.abs(expected).max()
    np.testing.assert_allclose(np.array(printed[:-1], float), expected, atol=1e-12 * scale, rtol=0)
    assert float(printed[-1]) == 0.01


def test_a_polynomial_model_leaves_and_comes_back(tmp_path):
    model = evopem.PolynomialModel(
        A=np.ones(1),
        B=np.array([1.0, 0.5]),
        C=np.array([1.0, 0.3]),
        D=np.array([1.0, -0.7]),
        F=np.array([1.0, -1.2, 0.8]),
        nk=2,
        sampling_rate=50.0,
        level=0.25,
        noise_variance=0.04,
        covariance=covariance_of_matrix(1e-4 * np.eye(6)),
        structure="bj",
    )
    save_model_mat(model, tmp_path / "model.mat")
    stored = loadmat(tmp_path / "model.mat")
    for name, expected in (("A", model.A), ("C", model.C), ("D", model.D), ("F", model.F[0])):
        np.testing.assert_array_equal(stored[name][0], expected)
    np.testing.assert_array_equal(stored["B"][0], [0, 0, 1.0, 0.5])
    assert stored["Level"][0, 0] == 0.25
    save(model, tmp_path / "model.json")
    loaded = evopem.load(tmp_path / "model.json")
    assert loaded.structure == "bj"
    assert (loaded.nk, loaded.sampling_rate, loaded.level) == ((2,), 50.0, 0.25)
    np.testing.assert_array_equal(loaded.parameters, model.parameters)
    np.testing.assert_array_equal(loaded.covariance, model.covariance)


def test_a_file_that_is_no_model_is_refused(tmp_path):
    (tmp_path / "model.json").write_text('{"structure": "oe"}')
    with pytest.raises(InputError, match=r"model\.json"):
        evopem.load(tmp_path / "model.json")
