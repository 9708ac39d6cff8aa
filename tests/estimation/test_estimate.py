"""Estimates against independent estimators and known truths."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.optimize import least_squares
from scipy.signal import lfilter

from evopem import (
    Constraints,
    Recording,
    ScoringWindow,
    SearchSettings,
    estimate,
    estimate_varying,
)
from evopem.estimation.pem.covariance import estimate_covariance
from evopem.estimation.pem.polynomial_errors import PolynomialErrors
from evopem.estimation.search import linear_estimates
from evopem.estimation.search.linear_estimates import arx
from evopem.estimation.search.polynomial_problem import PolynomialProblem
from evopem.models.orders import Orders
from evopem.signals.recording import Segment, recording_of
from evopem.synthesis import armax

QUADRATIC = SearchSettings(objective="quadratic")


def small_record(seed=1, samples=400, noise=0.5):
    rng = np.random.default_rng(seed)
    u, e = rng.standard_normal((2, samples))
    a, b, c = [1.0, -1.5, 0.7], [0.0, 1.0, 0.5], [1.0, -0.6]
    return u, lfilter(b, a, u) + lfilter(c, a, noise * e)


def test_arx_recovers_a_noise_free_system():
    rng = np.random.default_rng(2)
    u = rng.standard_normal(300)
    y = lfilter([0.0, 1.0, 0.5], [1.0, -1.5, 0.7], u)
    found = arx(u[:, None], y, 2, (2,), (1,))
    np.testing.assert_allclose(found, [-1.5, 0.7, 1.0, 0.5], atol=1e-10)


def of_orders(record, **orders):
    u, y = record
    stretches = [Segment(u[:, None], y[:, None], 0)]
    return PolynomialProblem(
        PolynomialErrors(stretches, Orders(**orders), "quadratic", 0.999, 0.999, True)
    )


def test_structures_that_share_orders_estimate_denominators_once(monkeypatch):
    calls, method = [], linear_estimates.steiglitz_mcbride
    monkeypatch.setattr(
        linear_estimates, "steiglitz_mcbride", lambda *given: calls.append(1) or method(*given)
    )
    record = small_record(seed=7)
    of_f, of_a = of_orders(record, nb=2, nf=2, nk=1), of_orders(record, na=2, nb=2, nc=2, nk=1)
    first, second = (list(linear_estimates.common_denominators(p.errors)) for p in (of_f, of_a))
    np.testing.assert_array_equal(first[1:], second[1:])
    assert len(calls) == 1
    list(linear_estimates.common_denominators(of_orders(record, nb=3, nf=2, nk=1).errors))
    list(linear_estimates.common_denominators(of_orders(record[::-1], nb=2, nf=2, nk=1).errors))
    assert len(calls) == 3


def test_points_are_completed_together_to_the_bits_of_each_alone():
    problem = of_orders(small_record(), na=2, nb=2, nc=2, nk=1)
    points = problem.random(11, np.random.default_rng(1))
    together, _ = problem.completed(points, alone=True)
    alone = [problem.completed(point[None])[0][0] for point in points]
    np.testing.assert_array_equal(together, alone)


@pytest.mark.filterwarnings("ignore")
def test_quadratic_estimate_agrees_with_statsmodels():
    """The ARMAX model is a regression on lagged signals with moving-average errors."""
    sarimax = pytest.importorskip("statsmodels.tsa.statespace.sarimax")
    u, y = small_record(samples=800)
    found = estimate(u, y, (2, 2, 1, 1), settings=QUADRATIC, window=ScoringWindow(2, 3))
    t = np.arange(2, len(y))
    lagged = np.column_stack([-y[t - 1], -y[t - 2], u[t - 1], u[t - 2]])
    theirs = sarimax.SARIMAX(y[2:], exog=lagged, order=(0, 0, 1)).fit(disp=False)
    # Exact likelihood against sum of squares from a zero past: they differ by the first residuals.
    np.testing.assert_allclose(found.model.parameters, theirs.params[:5], atol=5e-3)
    np.testing.assert_allclose(np.sqrt(np.diag(found.model.covariance)), theirs.bse[:5], rtol=0.1)


@pytest.mark.parametrize("seed", [1, 2, 3])
def test_no_local_method_finds_less(seed):
    """10 starts of SciPy's Levenberg-Marquardt on the chapter's orders, a short record."""
    recording, _ = armax(seed=seed, samples=500)
    u, y = recording.input, recording.output
    found = estimate(u, y, (7, 6, 7, 3), settings=QUADRATIC, window=ScoringWindow(8, 110))

    def residuals(p):
        a, b, c = np.r_[1.0, p[:7]], np.r_[0.0, 0.0, 0.0, p[7:13]], np.r_[1.0, p[13:]]
        w = (lfilter(a, [1.0], y) - lfilter(b, [1.0], u))[8:]
        e = lfilter([1.0], c, w)[102:]
        return np.clip(np.nan_to_num(e, nan=1e6), -1e6, 1e6)

    rng = np.random.default_rng(seed)
    of_arx = arx(u[:, None], y, 7, (6,), (3,))
    best = np.inf
    for trial in range(10):
        noise_start = 0.2 * rng.standard_normal(7) if trial else np.zeros(7)
        local = least_squares(residuals, np.r_[of_arx, noise_start], method="lm", max_nfev=3000)
        inside = np.abs(np.roots(np.r_[1.0, local.x[13:]])).max() < 0.9999
        stable = np.abs(np.roots(np.r_[1.0, local.x[:7]])).max() < 0.9999
        if inside and stable:
            best = min(best, 100 * 2 * local.cost / np.sum(y[110:] ** 2))
    assert np.isfinite(best)
    assert found.criteria.objective <= best * (1 + 1e-6)


def test_a_noise_state_that_hardly_affects_the_residuals_stays_small():
    """It does not keep the restarts of a search from agreeing to the last digits."""
    recording, _ = armax(seed=5, samples=4500)
    found = estimate(recording.input, recording.output, (7, 6, 7, 3), settings=QUADRATIC)
    diagnostics = found.search.diagnostics
    assert diagnostics.n_confirming == diagnostics.n_restarts - 1 >= 1
    assert np.ptp(diagnostics.restart_minima) < 1e-9 * found.search.value
    assert np.abs(found.noise_state).max() < 10 * np.sqrt(found.model.noise_variance)


@pytest.mark.parametrize("objective", ["absolute", "quadratic"])
def test_errors_of_the_estimate_are_within_its_standard_errors(objective):
    recording, truth = armax(seed=4, samples=4500)
    settings = SearchSettings(objective=objective)
    found = estimate(recording.input, recording.output, (7, 6, 7, 3), 100.0, settings=settings)
    true = np.r_[truth.a[1:], truth.b, truth.c[1:]]
    deviation = found.model.parameters - true
    # Mahalanobis distance: chi-square with 20 degrees of freedom, 99.9 % point 45.3.
    assert deviation @ np.linalg.solve(found.model.covariance, deviation) < 45.3
    for mode, expected in zip(found.model.modes(), truth.modes, strict=True):
        assert abs(mode.frequency_hz - expected.frequency_hz) < 4 * mode.frequency_se_hz
        assert abs(mode.damping_ratio - expected.damping_ratio) < 4 * mode.damping_se
    variance = truth.noise["innovation_variance"]
    # Relative standard deviation of a variance from 4400 samples: 2 %.
    assert found.model.noise_variance == pytest.approx(variance, rel=0.08)


@pytest.mark.parametrize("objective", ["absolute", "quadratic"])
def test_criteria_are_those_of_the_residuals(objective):
    u, y = small_record()
    settings = SearchSettings(objective=objective)
    found = estimate(u, y, (2, 2, 1, 1), settings=settings, window=ScoringWindow(10, 50))
    assert found.window == ScoringWindow(10, 50)
    past = replace(found.model, C=np.ones(1)).residuals(u, y)[10:]  # A y - B u, noise state aside
    state = np.pad(found.noise_state, (0, len(past) - len(found.noise_state)))
    e = lfilter([1.0], found.model.C, past + state)[40:]
    scored = y[50:]
    np.testing.assert_allclose(found.residuals[50:], e, atol=1e-9)
    assert np.isnan(found.residuals[:10]).all()
    absolute, rss = 100 * np.abs(e).sum() / np.abs(scored).sum(), 100 * (e @ e) / (scored @ scored)
    expected = {"absolute": absolute, "quadratic": rss}[objective]
    assert found.criteria.objective == pytest.approx(expected)
    deviation = np.linalg.norm(scored - scored.mean())
    nrmse = 100 * (1 - np.linalg.norm(e) / deviation)
    assert found.criteria.fit_percent == pytest.approx(nrmse)
    assert found.criteria.rss == pytest.approx(rss)
    assert found.criteria.bic == pytest.approx(np.log(e @ e / 350) + 5 * np.log(350) / 350)


def test_the_default_window_leaves_out_what_the_settings_say():
    u, y = small_record()
    found = estimate(u, y, (2, 2, 1, 8), settings=SearchSettings(n_initial_discard=12))
    assert found.window == ScoringWindow(9, 9 + 12)
    more = estimate(u, y, (1, 1, 3, 5), settings=SearchSettings(n_initial_discard=0))
    assert more.window == ScoringWindow(5, 5 + 3)


@pytest.mark.parametrize("objective", ["absolute", "quadratic"])
def test_over_parameterised_models_are_stable_and_invertible(objective):
    u, y = small_record(samples=150)
    settings = SearchSettings(objective=objective, max_root_radius=0.98, evaluations=3000)
    found = estimate(u, y, (8, 8, 8, 0), settings=settings, window=ScoringWindow(8, 40))
    assert np.abs(found.model.poles()).max() < 0.98 * (1 + 1e-6)
    assert np.abs(found.model.noise_zeros()).max() < 0.98 * (1 + 1e-6)


@pytest.mark.parametrize("residuals", [np.full(200, 3.0), np.linspace(3.0, 3.01, 200)])
def test_without_residuals_about_zero_the_absolute_estimate_has_no_covariance(residuals):
    """Its covariance needs their density at zero; the quadratic one needs their variance alone."""
    given = (np.eye(4), residuals, 10 * residuals, 3, np.array([2]))
    assert estimate_covariance(*given, "absolute") is None
    assert estimate_covariance(*given, "quadratic") is not None


def test_outliers_move_the_absolute_estimate_less():
    u, y = small_record(samples=2000, noise=0.2)
    rng = np.random.default_rng(9)
    spoiled = y + 20 * rng.standard_normal(2000) * (rng.random(2000) < 0.02)
    truth = np.array([-1.5, 0.7, 1.0, 0.5])
    errors = {
        objective: np.abs(
            estimate(
                u, spoiled, (2, 2, 2, 1), settings=SearchSettings(objective=objective)
            ).model.parameters[:4]
            - truth
        ).sum()
        for objective in ("absolute", "quadratic")
    }
    assert errors["absolute"] < 0.5 * errors["quadratic"]


def test_the_same_seed_gives_the_same_bits_and_the_record_stays():
    u, y = small_record()
    before = u.copy(), y.copy()
    one, two = (estimate(u, y, (4, 4, 4, 0), settings=SearchSettings(seed=7)) for _ in range(2))
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
    np.testing.assert_array_equal(one.A, other.A)
    np.testing.assert_array_equal(one.B[0], other.B[0] / scale**2)
    np.testing.assert_allclose(
        other.covariance.matrix[:2, :2], one.covariance.matrix[:2, :2], rtol=1e-9
    )


@pytest.mark.parametrize(
    ("settings", "window", "message"),
    [
        (SearchSettings(objective="cubic"), None, "objective must be"),
        (SearchSettings(refine="none"), None, "refine must be"),
        (SearchSettings(max_root_radius=1.0), None, "max_root_radius must lie"),
        (SearchSettings(seed=-1), None, "seed must be at least 0, not -1"),
        (SearchSettings(nu=0), None, "nu must be at least 1, not 0"),
        (None, ScoringWindow(1, 30), "no residual before"),
        (None, ScoringWindow(9, 8), "before the first residual"),
        (None, ScoringWindow(9, 398), "needs more than 5 residuals"),
    ],
)
def test_settings_that_make_no_sense_are_refused(settings, window, message):
    u, y = small_record()
    with pytest.raises(ValueError, match=message):
        estimate(u, y, (2, 2, 1, 1), settings=settings, window=window)


def test_signals_that_make_no_sense_are_refused():
    u, y = small_record()
    with pytest.raises(ValueError, match="one length"):
        estimate(u[:-1], y, (2, 2, 1, 1))
    with pytest.raises(ValueError, match="finite"):
        estimate(u, np.where(np.arange(400) == 7, np.nan, y), (2, 2, 1, 1))
    with pytest.raises(ValueError, match="zero throughout"):
        estimate(u, np.zeros(400), (2, 2, 1, 1))


@pytest.mark.parametrize("call", [lambda *given: estimate(*given, (1, 1, 1, 1)), estimate_varying])
@pytest.mark.parametrize(
    ("output", "says"),
    [
        (["a"] * 400, "output: it holds no real numbers"),
        (1.0, "output: it holds no real numbers"),
        ([1.0, [2.0, 3.0]], "output: it holds no real numbers"),
        (np.ones((1, 1, 400)), "output: it holds no real numbers in one or two dimensions"),
        (np.ones((4, 400)), r"output: the signals have the shape \(4, 400\); give samples in rows"),
        (np.ma.masked_less(np.arange(400.0), 3.0), 'output "output" must be finite'),
        (np.full(400, np.inf), 'output "output" must be finite'),
        ([], "output: it has no samples"),
    ],
)
def test_signals_that_are_no_samples_are_refused_in_one_sentence(call, output, says):
    with pytest.raises(ValueError, match=says):
        call(np.ones(400), output)


def test_a_row_is_the_samples_of_one_channel():
    u, y = small_record()
    taken = recording_of(u[None], y[None], np.array(2.0))
    np.testing.assert_array_equal(taken.output, y)
    np.testing.assert_array_equal(taken.input, u)


@pytest.mark.parametrize("rate", [-5.0, 0.0, float("nan"), float("inf"), "5"])
def test_a_sampling_rate_that_is_none_is_refused(rate):
    u = np.random.default_rng(0).standard_normal((2, 300))
    with pytest.raises(ValueError, match="sampling_rate must be a positive number of Hz"):
        estimate(*u, (1, 1, 1, 1), rate)


@pytest.mark.parametrize("orders", [(1.0, 1, 1, 1), (1, 1, 1), ("1", 1, 1, 1), (1, 1, 1, None)])
def test_orders_that_are_no_whole_numbers_are_refused(orders):
    u = np.random.default_rng(0).standard_normal((2, 300))
    with pytest.raises(
        ValueError, match=r"must be a whole number|takes the orders \(na, nb, nc, nk\)"
    ):
        estimate(*u, orders)


def test_complex_and_extreme_signals_are_refused():
    u, y = np.random.default_rng(0).standard_normal((2, 300))
    with pytest.raises(ValueError, match="input: it holds no real numbers"):
        estimate(u + 1j, y, (1, 1, 1, 1))
    with pytest.raises(ValueError, match="largest magnitude of the input"):
        estimate(1e-200 * u, y, (1, 1, 1, 1))


def test_a_level_of_a_signal_is_warned_of_and_a_small_one_is_not(recwarn):
    u, y = np.random.default_rng(0).standard_normal((2, 300))
    u, y = u - u.mean(), y - y.mean()
    few = SearchSettings(evaluations=100)
    estimate(u, y + 0.02, (1, 1, 1, 1), settings=few)
    assert not [each for each in recwarn if "the mean of " in str(each.message)]
    structures = {"armax": (1, 1, 1, 1), "oe": (1, 1, 1), "arx": (1, 1, 1), "ss": 1, "ss_oe": 1}
    for structure, orders in structures.items():
        with pytest.warns(UserWarning, match="subtract the means of input and output"):
            estimate(u, y + 1.0, orders, structure=structure, settings=few)
    with pytest.warns(UserWarning, match='the mean of input "input" is'):
        estimate(u + 5.0, y, (1, 1, 1), structure="oe", settings=few)


@pytest.mark.parametrize("kind", ["constant", "zero", "twice", "a sum"])
def test_an_input_with_nothing_of_its_own_is_warned_of_and_spoils_no_error(kind):
    generator = np.random.default_rng(1)
    u = generator.standard_normal((400, 2))
    x = lfilter([0.0, 1.0, 0.5], [1.0, -1.7, 0.9604], u[:, 0]) + lfilter([0.0, 1.0], [1.0], u[:, 1])
    y = x + 0.1 * x.std() * generator.standard_normal(400)
    more = {"constant": np.full(400, 3.0), "zero": np.zeros(400), "twice": 2.0 * u[:, 0]}
    given = np.column_stack([u, more.get(kind, u.sum(axis=1))])
    few = SearchSettings(objective="quadratic", evaluations=200)
    with pytest.warns(UserWarning, match="input 'input 3' is constant, or follows from"):
        found = estimate(given, y, {"nb": 2, "nf": 2, "nk": 1}, structure="oe", settings=few)
    (mode,) = (each for each in found.model.modes() if abs(each.frequency_hz - 0.083) < 0.002)
    assert mode.frequency_se_hz < 1e-3


def test_the_fit_is_relative_to_the_mean():
    generator = np.random.default_rng(3)
    u = generator.standard_normal(400)
    y = np.convolve(u, [0.0, 1.0, 0.5])[:400] + 0.3 * generator.standard_normal(400)
    found = estimate(u, y, (1, 2, 1, 1), settings=SearchSettings(objective="quadratic"))
    scored = slice(found.window.loss_start, None)
    e, measured = found.residuals[scored], y[scored]
    expected = 100 * (1 - np.linalg.norm(e) / np.linalg.norm(measured - measured.mean()))
    assert found.criteria.fit_percent == pytest.approx(expected)


def test_several_recordings_without_input_meet_constraints():
    y = np.random.default_rng(0).standard_normal(200)
    joined = Recording(
        np.empty((200, 0)), y, 1.0, segment_starts=(0, 100), segment_recordings=(0, 1)
    )
    fixed = Constraints(fixed_coefficients={"a1": 0.25})
    found = estimate(joined, orders=(1, 1), structure="arma", constraints=fixed)
    assert found.model.A[1] == 0.25
