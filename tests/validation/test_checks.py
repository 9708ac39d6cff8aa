"""Checks pass on evidence, fail on counter-evidence, and say when there is neither."""

import copy

import numpy as np
import pandas as pd
import pytest

from evopem.models.polynomials import root_gradient
from evopem.models.root_covariance import root_covariance
from evopem.validation import checks

POLES = [0.9 * np.exp(0.5j), 0.9 * np.exp(-0.5j)]
# ω = |ln z| at one sample a second.
FREQUENCY = abs(np.log(POLES[0])) / (2 * np.pi)


@pytest.fixture
def model():
    return {
        "orders": {"na": 2, "nb": 2, "nc": 1, "nk": 1},
        "a": np.real(np.poly(POLES)).tolist(),
        "b": [1.0, -0.5],
        "c": [1.0, 0.4],
        "sampling_rate": 1.0,
        "covariance": (1e-6 * np.eye(5)).tolist(),
        "modes": [{"frequency_hz": FREQUENCY, "damping_percent": 20.0, "frequency_se_hz": 1e-4}],
        "search": {
            "settings": {"max_root_radius": 0.9999},
            "found": {"populations": 3, "agreement": 0.5, "at_margin": False},
        },
    }


@pytest.fixture
def validation():
    return {
        "autocorrelation_share_inside95": 0.952,
        "lags": 1200,
        "ljung_box": {"statistic": 20.0, "degrees_of_freedom": 22, "p_value": 0.6, "lags": 36},
        "cross_correlation": {
            "share_inside95": 0.95,
            "max_abs": 0.03,
            "max_in_bounds": 1.4,
            "lags": 200,
        },
        "excitation": {"order": 4, "needed": 4},
        "residual_outlier_percent": 0.0,
    }


@pytest.fixture
def recording():
    return {"input_saturated_percent": 0.0, "output_saturated_percent": 0.0}


@pytest.fixture
def spectrum():
    return {"resolution_hz": 0.01, "peaks": [{"frequency_hz": FREQUENCY}]}


@pytest.fixture
def candidates():
    rows = [("delay", 3, 3, 3, nk, nk == 1) for nk in range(4)]
    rows += [("common", k, k, k, 1, k == 3) for k in range(2, 6)]
    rows += [("c", 3, 3, k, 1, k == 3) for k in range(2, 6)]
    rows += [("b", 3, k, 3, 1, k == 3) for k in range(2, 6)]
    return pd.DataFrame(rows, columns=["phase", "na", "nb", "nc", "nk", "selected"])


def verdict(results, start):
    (found,) = [check for check in results if check.name.startswith(start)]
    return found


def test_good_evidence_passes_every_check(model, validation, spectrum, candidates, recording):
    results = checks(model, validation, spectrum, candidates, recording)
    assert [check.passed for check in results] == [True] * 13
    assert all(check.statement and not check.advice for check in results)


def test_without_evidence_nothing_passes():
    results = checks({})
    assert [check.passed for check in results] == [None] * 13
    assert all("missing" in check.statement or "not on" in check.statement for check in results)
    assert all(check.advice for check in results)


@pytest.mark.parametrize(
    ("path", "name"),
    [
        (("model", "a"), "Stable"),
        (("model", "c"), "Invertible"),
        (("model", "modes"), "Every"),
        (("model", "covariance"), "Poles"),
        (("model", "search", "found", "at_margin"), "Roots"),
        (("model", "search", "found", "populations"), "Search"),
        (("model", "search", "found", "agreement"), "Search"),
        (("validation", "ljung_box", "p_value"), "White"),
        (("validation", "autocorrelation_share_inside95"), "White"),
        (("validation", "cross_correlation", "max_in_bounds"), "Residuals"),
        (("validation", "excitation"), "Excitation"),
        (("validation", "residual_outlier_percent"), "Few"),
        (("model", "covariance"), "Input"),
        (("recording", "output_saturated_percent"), "Record"),
        (("spectrum", "peaks"), "Every"),
    ],
)
@pytest.mark.parametrize("how", ["absent", "null"])
def test_one_missing_number_leaves_its_check_open(
    path, name, how, model, validation, spectrum, candidates, recording
):
    given = copy.deepcopy(
        {
            "model": model,
            "validation": validation,
            "spectrum": spectrum,
            "recording": recording,
        }
    )
    place = given
    for key in path[:-1]:
        place = place[key]
    if how == "absent":
        del place[path[-1]]
    else:
        place[path[-1]] = None
    results = checks(
        given["model"], given["validation"], given["spectrum"], candidates, given["recording"]
    )
    assert verdict(results, name).passed is None
    assert verdict(results, name).advice


def test_roots_outside_fail(model):
    model["a"] = [1.0, -1.2]
    model["c"] = [1.0, 1.0]
    results = checks(model)
    for name in ("Stable", "Invertible"):
        assert verdict(results, name).passed is False
        assert verdict(results, name).advice


@pytest.mark.parametrize(
    ("changes", "passed"),
    [
        ({"autocorrelation_share_inside95": 0.90}, False),
        ({"autocorrelation_share_inside95": 0.94}, True),
    ],
)
def test_whiteness_by_share(validation, changes, passed):
    assert verdict(checks({}, validation | changes), "White").passed is passed


def test_whiteness_by_ljung_box(validation):
    validation["ljung_box"]["p_value"] = 1e-5
    assert verdict(checks({}, validation), "White").passed is False


def test_one_large_cross_correlation_fails(validation):
    validation["cross_correlation"]["max_in_bounds"] = 3.0
    check = verdict(checks({}, validation), "Residuals")
    assert check.passed is False
    assert "raise nb" in check.advice


def test_largest_of_many_cross_correlations_fails_good_models_rarely():
    """The allowed maximum holds its level: 1 % of independent white pairs exceed it."""
    from evopem.validation.residual_tests import cross_correlation, share_inside

    rng = np.random.default_rng(1)
    failed = 0
    for _ in range(300):
        table = cross_correlation(rng.normal(size=1500), rng.normal(size=1500), 200)
        ratio = table["cross_correlation"].abs() / table["bound95"]
        share = share_inside(table["cross_correlation"], table["bound95"])
        cross = {"share_inside95": share, "max_in_bounds": ratio.max(), "lags": 200}
        failed += verdict(checks({}, {"cross_correlation": cross}), "Residuals").passed is False
    assert failed <= 10  # expectation 3; more than 10 has a probability below 0.1 %


def test_a_missed_peak_is_named(model, spectrum):
    spectrum["peaks"].append({"frequency_hz": 0.4})
    check = verdict(checks(model, spectrum=spectrum), "Every")
    assert check.passed is False
    assert "0.4 Hz" in check.statement


@pytest.mark.parametrize(("damping", "error"), [(84.0, 0.001), (40.0, 0.2)])
def test_a_broad_or_uncertain_mode_does_not_pass_for_every_peak(model, spectrum, damping, error):
    model["modes"][0] |= {"damping_percent": damping, "frequency_se_hz": error}
    spectrum["peaks"] = [{"frequency_hz": 1.3 * FREQUENCY}]
    assert verdict(checks(model, spectrum=spectrum), "Every").passed is False


def test_lines_of_a_periodic_input_are_not_taken_for_modes(model, spectrum):
    jitter = np.random.default_rng(3).uniform(-0.1, 0.1, 60)
    spectrum["peaks"] = [{"frequency_hz": k + j} for k, j in enumerate(jitter, start=1)]
    check = verdict(checks(model, spectrum=spectrum), "Every")
    assert check.passed is None
    assert "60 peaks about" in check.statement


def test_many_uneven_peaks_are_judged_and_not_all_listed(model, spectrum):
    spectrum["peaks"] = [{"frequency_hz": 1.3**k} for k in range(1, 16)]
    check = verdict(checks(model, spectrum=spectrum), "Every")
    assert check.passed is False
    assert "and 9 more" in check.statement


def test_a_spectrum_without_peaks_misses_none(model):
    check = verdict(checks(model, spectrum={"peaks": [], "resolution_hz": 0.1}), "Every")
    assert check.passed is True
    assert "no distinct peak" in check.statement


def test_cancellation_is_judged_by_uncertainty(model):
    # A real pole at 0.5 with a zero 0.02 away from it.
    model["a"] = np.real(np.poly([*POLES, 0.5])).tolist()
    model["b"] = [1.0, -0.52]
    model["covariance"] = (1e-8 * np.eye(6)).tolist()
    assert verdict(checks(model), "Poles").passed is True
    model["covariance"] = (1e-2 * np.eye(6)).tolist()
    assert verdict(checks(model), "Poles").passed is False


def test_complex_cancellation(model):
    model["b"] = np.real(np.poly(np.array(POLES) * 1.01)).tolist()
    model["covariance"] = (1e-4 * np.eye(5)).tolist()
    assert verdict(checks(model), "Poles").passed is False
    model["covariance"] = (1e-10 * np.eye(5)).tolist()
    assert verdict(checks(model), "Poles").passed is True


def test_coincident_roots_fail_even_without_covariance(model):
    del model["covariance"]
    model["b"] = np.real(np.poly(np.array(POLES) * 1.0001)).tolist()
    assert verdict(checks(model), "Poles").passed is False


@pytest.mark.parametrize(
    ("phase", "column", "value", "passed"),
    [
        ("delay", "nk", 3, False),
        ("delay", "nk", 0, True),  # no delay can be shorter
        ("common", "na", 5, False),
        ("common", "na", 2, False),
        ("c", "nc", 5, False),
        ("b", "nb", 4, True),
    ],
)
def test_edges_of_the_ranges(candidates, phase, column, value, passed):
    own = candidates["phase"] == phase
    candidates.loc[own, "selected"] = candidates.loc[own, column] == value
    assert verdict(checks({}, candidates=candidates), "Orders").passed is passed


def test_a_root_on_the_margin_fails(model):
    model["search"]["found"]["at_margin"] = True
    check = verdict(checks(model), "Roots")
    assert check.passed is False
    assert "0.9999" in check.statement
    assert check.advice


@pytest.mark.parametrize(
    ("populations", "agreement", "passed", "statement"),
    [
        (1, 0.0, None, "no independent one"),
        (2, 0.0, False, "0 of 1 further population,"),
        (2, 1.0, True, "1 of 1 further population,"),
        (7, 1 / 3, True, "2 of 6 further populations"),
    ],
)
def test_agreement_of_independent_populations(model, populations, agreement, passed, statement):
    model["search"]["found"] |= {"populations": populations, "agreement": agreement}
    check = verdict(checks(model), "Search")
    assert check.passed is passed
    assert statement in check.statement
    assert bool(check.advice) == (passed is not True)


def test_no_search_at_all_is_not_judged(candidates):
    fixed = candidates[candidates["selected"]]
    assert verdict(checks({}, candidates=fixed), "Orders").passed is None


def test_a_phase_without_choice_is_not_judged(candidates):
    assert verdict(checks({}, candidates=candidates.iloc[4:]), "Orders").passed is None


def test_weak_excitation_fails(validation):
    validation["excitation"]["order"] = 2
    assert verdict(checks({}, validation), "Excitation").passed is False


@pytest.mark.parametrize(
    ("objective", "percent", "passed"),
    [
        ("quadratic", 0.1, True),
        ("quadratic", 0.2, False),
        ("absolute", 5, True),
        ("absolute", 6, False),
    ],
)
def test_outliers_weigh_by_the_objective(model, validation, objective, percent, passed):
    model["objective"] = {"name": objective, "value": 1.0}
    validation["residual_outlier_percent"] = percent
    check = verdict(checks(model, validation), "Few")
    assert check.passed is passed
    assert ("“absolute”" in check.advice) == (not passed and objective == "quadratic")


def test_a_gain_within_its_uncertainty_fails(model):
    model["b"] = [0.001, -0.0005]
    assert verdict(checks(model), "Input").passed is False


def test_a_channel_cut_off_is_named(recording):
    check = verdict(checks({}, recording=recording | {"output_saturated_percent": 3.0}), "Record")
    assert check.passed is False
    assert check.statement.startswith("3 % of the output rests")


def test_root_gradient_against_finite_differences():
    coefficients = np.array([1.0, -1.5, 0.9, -0.2])
    for root in np.roots(coefficients):
        gradient = root_gradient(coefficients, root)
        for i in range(coefficients.size):
            moved = []
            for step in (1e-6, -1e-6):
                changed = coefficients.copy()
                changed[i] += step
                candidates = np.roots(changed)
                moved.append(candidates[np.argmin(np.abs(candidates - root))])
            assert gradient[i] == pytest.approx((moved[0] - moved[1]) / 2e-6, rel=1e-5, abs=1e-7)


def test_root_covariance_by_monte_carlo():
    rng = np.random.default_rng(2)
    a = np.real(np.poly(POLES))
    covariance = 1e-6 * np.array([[2.0, 0.5], [0.5, 1.0]])
    drawn = rng.multivariate_normal(a[1:], covariance, size=20_000)
    # The roots of z² + a1 z + a2 in closed form.
    roots = (-drawn[:, 0] + np.sqrt(drawn[:, 0] ** 2 - 4 * drawn[:, 1] + 0j)) / 2
    sampled = np.cov(roots.real, np.abs(roots.imag))
    np.testing.assert_allclose(root_covariance(a, POLES[0], covariance), sampled, rtol=0.05)


def test_root_covariance_of_a_polynomial_that_is_not_monic():
    # The root of b0 z + b1 is −b1/b0, its variance by propagation (var b1 + r² var b0) / b0².
    b = np.array([2.0, -1.0])
    spread = root_covariance(b, 0.5, np.diag([0.01, 0.04]))
    np.testing.assert_allclose(spread, [[(0.04 + 0.25 * 0.01) / 4, 0.0], [0.0, 0.0]])
