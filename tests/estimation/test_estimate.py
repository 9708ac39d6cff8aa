"""Estimates against independent estimators and known truths."""

import numpy as np
import pytest
from scipy.optimize import least_squares
from scipy.signal import lfilter

from evopem import Orders, SearchSettings, estimate
from evopem.estimation.pem.arx import fit_arx
from evopem.synthesis.armax import armax


def small_record(seed=1, samples=400, noise=0.5):
    rng = np.random.default_rng(seed)
    u, e = rng.standard_normal((2, samples))
    a, b, c = [1.0, -1.5, 0.7], [0.0, 1.0, 0.5], [1.0, -0.6]
    return u, lfilter(b, a, u) + lfilter(c, a, noise * e)


def test_arx_recovers_a_noise_free_system():
    rng = np.random.default_rng(2)
    u = rng.standard_normal(300)
    y = lfilter([0.0, 1.0, 0.5], [1.0, -1.5, 0.7], u)
    np.testing.assert_allclose(
        fit_arx(u, y, Orders(2, 2, 0, 1), 20), [-1.5, 0.7, 1.0, 0.5], atol=1e-10
    )


@pytest.mark.filterwarnings("ignore")
def test_quadratic_estimate_agrees_with_statsmodels():
    """The ARMAX model is a regression on lagged signals with moving-average errors."""
    statsmodels = pytest.importorskip("statsmodels.api")
    u, y = small_record(samples=800)
    found = estimate(u, y, (2, 2, 1, 1), objective="quadratic", scoring_start=3)
    t = np.arange(2, len(y))
    lagged = np.column_stack([-y[t - 1], -y[t - 2], u[t - 1], u[t - 2]])
    theirs = statsmodels.tsa.SARIMAX(y[2:], exog=lagged, order=(0, 0, 1)).fit(disp=False)
    # Exact likelihood against sum of squares from a zero past: they differ by the first residuals.
    np.testing.assert_allclose(found.model.parameters, theirs.params[:5], atol=5e-3)
    np.testing.assert_allclose(np.sqrt(np.diag(found.model.covariance)), theirs.bse[:5], rtol=0.1)


@pytest.mark.parametrize("seed", [1, 2, 3])
def test_no_local_method_finds_less(seed):
    """20 starts of SciPy's Levenberg-Marquardt on the chapter's orders, a short record."""
    recording, _ = armax(seed=seed, samples=500)
    u, y = recording.input, recording.output
    found = estimate(u, y, (7, 6, 7, 3), objective="quadratic", scoring_start=110)

    def residuals(p):
        a, b, c = np.r_[1.0, p[:7]], np.r_[0.0, 0.0, 0.0, p[7:13]], np.r_[1.0, p[13:]]
        w = (lfilter(a, [1.0], y) - lfilter(b, [1.0], u))[8:]
        e = lfilter([1.0], c, w)[102:]
        return np.clip(np.nan_to_num(e, nan=1e6), -1e6, 1e6)

    rng = np.random.default_rng(seed)
    arx = fit_arx(u, y, Orders(7, 6, 7, 3), 110)
    best = np.inf
    for trial in range(20):
        noise_start = 0.2 * rng.standard_normal(7) if trial else np.zeros(7)
        local = least_squares(residuals, np.r_[arx, noise_start], method="lm", max_nfev=3000)
        inside = np.abs(np.roots(np.r_[1.0, local.x[13:]])).max() < 0.9999
        stable = np.abs(np.roots(np.r_[1.0, local.x[:7]])).max() < 0.9999
        if inside and stable:
            best = min(best, 100 * 2 * local.cost / np.sum(y[110:] ** 2))
    assert np.isfinite(best)
    assert found.objective_value <= best * (1 + 1e-6)


def test_a_noise_state_that_the_data_hardly_see_stays_small():
    """And does not keep the populations of a search from agreeing to the last digits."""
    recording, _ = armax(seed=5, samples=4500)
    found = estimate(recording.input, recording.output, (7, 6, 7, 3), objective="quadratic")
    assert found.search.agreement == 1.0
    assert np.ptp(found.search.ends) < 1e-9 * found.search.value
    assert np.abs(found.noise_state).max() < 10 * np.sqrt(found.model.noise_variance)


@pytest.mark.parametrize("objective", ["absolute", "quadratic"])
def test_errors_of_the_estimate_are_within_its_standard_errors(objective):
    recording, truth = armax(seed=4, samples=4500)
    found = estimate(recording.input, recording.output, (7, 6, 7, 3), 100.0, objective=objective)
    true = np.r_[truth["a"][1:], truth["b"], truth["c"][1:]]
    deviation = found.model.parameters - true
    # Mahalanobis distance: chi-square with 20 degrees of freedom, 99.9 % point 45.3.
    assert deviation @ np.linalg.solve(found.model.covariance, deviation) < 45.3
    for mode, expected in zip(found.model.modes(), truth["modes"], strict=True):
        assert abs(mode.frequency_hz - expected["frequency_hz"]) < 4 * mode.frequency_se_hz
        assert abs(100 * mode.damping_ratio - expected["damping_percent"]) < 400 * mode.damping_se
    variance = truth["noise"]["innovation_variance"]
    # Relative standard deviation of a variance from 4400 samples: 2 %.
    assert found.model.noise_variance == pytest.approx(variance, rel=0.08)


def test_reported_numbers_are_those_of_the_residuals():
    u, y = small_record()
    found = estimate(u, y, (2, 2, 1, 1), scoring_start=50)
    e = found.model.residuals(u, y, found.noise_state, found.recursion_start)[50:]
    scored = y[50:]
    np.testing.assert_allclose(found.residuals[50:], e, atol=1e-9)
    assert found.objective_value == pytest.approx(100 * np.abs(e).sum() / np.abs(scored).sum())
    assert found.fit_percent == pytest.approx(100 - found.objective_value)
    assert found.rss == pytest.approx(100 * (e @ e) / (scored @ scored))
    assert found.bic == pytest.approx(np.log(e @ e / 350) + 5 * np.log(350) / 350)


@pytest.mark.parametrize("objective", ["absolute", "quadratic"])
def test_over_parameterised_models_are_stable_and_invertible(objective):
    u, y = small_record(samples=150)
    found = estimate(
        u,
        y,
        (8, 8, 8, 0),
        objective=objective,
        scoring_start=40,
        max_root_radius=0.98,
        search=SearchSettings(evaluations=3000),
    )
    assert np.abs(found.model.poles()).max() < 0.98 * (1 + 1e-6)
    assert np.abs(found.model.noise_zeros()).max() < 0.98 * (1 + 1e-6)


def test_outliers_move_the_absolute_estimate_less():
    u, y = small_record(samples=2000, noise=0.2)
    rng = np.random.default_rng(9)
    spoiled = y + 20 * rng.standard_normal(2000) * (rng.random(2000) < 0.02)
    truth = np.array([-1.5, 0.7, 1.0, 0.5])
    errors = {
        objective: np.abs(
            estimate(u, spoiled, (2, 2, 2, 1), objective=objective).model.parameters[:4] - truth
        ).sum()
        for objective in ("absolute", "quadratic")
    }
    assert errors["absolute"] < 0.5 * errors["quadratic"]


def test_the_same_seed_gives_the_same_bits_and_the_record_stays():
    u, y = small_record()
    before = u.copy(), y.copy()
    one, two = (estimate(u, y, (4, 4, 4, 0), seed=7) for _ in range(2))
    np.testing.assert_array_equal(one.model.parameters, two.model.parameters)
    np.testing.assert_array_equal(one.model.covariance, two.model.covariance)
    np.testing.assert_array_equal((u, y), before)


@pytest.mark.parametrize("exponent", [-150, -3, 150])
def test_units_do_not_matter(exponent):
    """A record in other units, by powers of two, gives the same model in those units."""
    u, y = small_record()
    one = estimate(u, y, (2, 2, 1, 1)).model
    scale = 2.0**exponent
    other = estimate(u / scale, y * scale, (2, 2, 1, 1)).model
    np.testing.assert_array_equal(one.a, other.a)
    np.testing.assert_array_equal(one.b, other.b / scale**2)
    np.testing.assert_allclose(
        other.covariance.matrix[:2, :2], one.covariance.matrix[:2, :2], rtol=1e-9
    )


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"objective": "cubic"}, "objective must be"),
        ({"max_root_radius": 1.0}, "max_root_radius must lie"),
        ({"recursion_start": 1}, "no residual before"),
        ({"scoring_start": 1}, "before the first residual"),
        ({"scoring_start": 398}, "more scored samples"),
        ({"search": SearchSettings(mutate="none")}, "mutate must be"),
    ],
)
def test_settings_that_make_no_sense_are_refused(change, message):
    u, y = small_record()
    with pytest.raises(ValueError, match=message):
        estimate(u, y, (2, 2, 1, 1), **change)


def test_signals_that_make_no_sense_are_refused():
    u, y = small_record()
    with pytest.raises(ValueError, match="one length"):
        estimate(u[:-1], y, (2, 2, 1, 1))
    with pytest.raises(ValueError, match="finite"):
        estimate(u, np.where(np.arange(400) == 7, np.nan, y), (2, 2, 1, 1))
    with pytest.raises(ValueError, match="zero throughout"):
        estimate(u, np.zeros(400), (2, 2, 1, 1))
