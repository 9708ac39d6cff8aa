"""Checks pass on evidence, fail on counter-evidence, and are not judged without either."""

import math
import re
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import pytest
from covariances import covariance_of_matrix
from identified import with_model, without_covariance

from evopem.config.defaults import complete
from evopem.estimation.model_record import ModelRecord
from evopem.estimation.search.certificate import POLYNOMIALS, STATE_SPACE
from evopem.models.modes import Mode
from evopem.models.orders import armax_orders
from evopem.models.polynomial import PolynomialModel
from evopem.models.polynomial_roots import root_covariance, root_gradient
from evopem.signals.recording_info import ChannelInfo, RecordingInfo
from evopem.validation.checks import CHECKS, Evidence, checks, failed_checks
from evopem.validation.checks.roots import cancelling_pairs
from evopem.validation.checks.search import RANGES, ranges_of_phases, repeatability
from evopem.validation.distortion import Distortion, Floor
from evopem.validation.error_parts import ErrorParts, Part
from evopem.validation.model_class import ResidualTest
from evopem.validation.residual_tests import correlation_with_input
from evopem.validation.spectra import PeakEvidence
from evopem.validation.validation import Validation

ROOT = Path(__file__).parents[2]
POLES = [0.9 * np.exp(0.5j), 0.9 * np.exp(-0.5j)]
# The mode of these poles at one sample a second: ω = |ln z|, ζ = −Re(ln z)/ω.
OMEGA = abs(np.log(POLES[0]))
FREQUENCY, DAMPING = OMEGA / (2 * np.pi), -math.log(0.9) / OMEGA


@dataclass(frozen=True)
class Given:
    """What the checks are given."""

    model: ModelRecord
    validation: Validation
    phases: dict
    recording: RecordingInfo

    @property
    def checks(self):
        """All checks of the model."""
        ranges = ranges_of_phases(self.phases)
        return checks(Evidence(self.model, self.validation, self.recording, ranges))

    def check(self, start):
        """The check whose name starts so."""
        (found,) = [check for check in self.checks if check.name.startswith(start)]
        return found

    def with_(self, part, **changes):
        """The same with other values in one part, or of the one output, input or pair."""
        if part in ("outputs", "inputs", "pairs"):
            (one,) = getattr(self.validation, part)
            return self.with_("validation", **{part: (replace(one, **changes),)})
        return replace(self, **{part: replace(getattr(self, part), **changes)})


def test_ranges_are_called_by_their_keys():
    for key, _ in RANGES.values():
        group, name = key.split(".")
        content = {"file": "a.csv", "recipe": "chapter", "structure": "general", group: {name: 3}}
        complete({"datasets": {"a": content}})


def with_polynomials(record, a, b, c, covariance):
    """A model record of other polynomials, with all that follows from them."""
    if covariance is not None:
        covariance = covariance_of_matrix(covariance)
    model = PolynomialModel(
        a, b, c, nk=1, sampling_rate=1.0, noise_variance=1.0, covariance=covariance
    )
    return with_model(record, model)


def with_peaks(evidence, frequencies, excess=9.0):
    """The same with peaks that chance makes up to three times as high as the model."""
    peaks = tuple(PeakEvidence(float(frequency), excess, 3.0) for frequency in frequencies)
    return evidence.with_("outputs", peaks=peaks).with_("validation", resolution_hz=0.01)


def with_diagnostics(evidence, **changes):
    search = evidence.model.search
    diagnostics = replace(search.diagnostics, **changes)
    return evidence.with_("model", search=replace(search, diagnostics=diagnostics))


def with_phase(evidence, phase, tried, selected):
    """The same with other candidates in one phase."""
    candidate = evidence.phases[phase].candidates[0]
    candidates = tuple(replace(candidate, orders=orders) for orders in tried)
    selection = replace(evidence.phases[phase], orders=selected, candidates=candidates)
    return replace(evidence, phases=evidence.phases | {phase: selection})


@pytest.fixture(scope="module")
def real(identified):
    """The evidence on a model that the package identified."""
    results = identified.results
    return Given(results.model, results.validation, results.phases, results.recording_info)


@pytest.fixture(scope="module")
def good(real):
    """The same with values that each check passes on."""
    a, b, c = np.real(np.poly(POLES)), np.array([1.0, -0.5]), np.array([1.0, 0.4])
    validation = real.validation
    (output,), (source,), (pair,) = validation.outputs, validation.inputs, validation.pairs
    found = Given(
        with_polynomials(real.model, a, b, c, 1e-6 * np.eye(5)),
        replace(
            validation,
            lags=1200,
            correlation_lags=200,
            outputs=(
                replace(
                    output,
                    autocorrelation_share_inside95=0.952,
                    ljung_box=replace(output.ljung_box, p_value=0.6),
                    outlier_percent=0.0,
                ),
            ),
            pairs=(replace(pair, p_value=0.6, max_in_bounds=1.4),),
            inputs=(replace(source, excitation_order=4, excitation_needed=4),),
        ),
        real.phases,
        replace(
            real.recording,
            inputs=(ChannelInfo("u", "", 0.0),),
            outputs=(ChannelInfo("y", "", 0.0),),
        ),
    )
    found = with_peaks(found, [FREQUENCY])
    found = with_diagnostics(
        found,
        restart_minima=(1.0, 1.0, 2.0),
        n_confirming=1,
        n_multistart=256,
        undiscovered_probability=0.001,
        supported=True,
    )
    found = with_phase(
        found, "delay", [armax_orders(3, 3, 3, k) for k in range(4)], armax_orders(3, 3, 3, 1)
    )
    for phase, order in (("plant", "na"), ("nc", "nc"), ("nb", "nb")):
        tried = [replace(armax_orders(3, 3, 3, 1), **{order: k}) for k in range(2, 6)]
        found = with_phase(found, phase, tried, armax_orders(3, 3, 3, 1))
    return found


def test_the_mode_of_the_poles_is_the_expected_one(good):
    (mode,) = good.model.modes
    assert (mode.frequency_hz, mode.damping_ratio) == pytest.approx((FREQUENCY, DAMPING))


def test_good_evidence_passes_every_check(good):
    results = good.checks
    assert [(check.name, check.passed) for check in results if check.passed is not True] == []
    assert len({check.name for check in results}) == len(results) == 18
    assert all(check.statement and not check.advice for check in results)


def test_checks_of_an_identified_model_say_what_is_in_its_results(real):
    """Statements hold the numbers; what did not pass comes with advice."""
    results = real.checks
    assert all(bool(check.advice) == (check.passed is not True) for check in results)
    largest = float(np.max(np.abs(np.roots(real.model.model.A))))
    assert real.check("Stable").passed is (largest < 1)
    assert f"{largest:.7f}" in real.check("Stable").statement
    # The delay's range ends at the true delay.
    assert real.check("Orders").passed is False
    assert "nk = 3 (delay.nk: 2 to 3)" in real.check("Orders").statement
    assert real.check("Response").passed is True
    assert "validation samples: coefficient" in real.check("Response").statement
    assert real.check("Validation input").passed is True


@pytest.mark.parametrize(
    ("part", "change", "name"),
    [
        ("model", {"poles": np.full(2, math.nan, dtype=complex)}, "Stable"),
        ("outputs", {"autocorrelation_share_inside95": math.nan}, "White"),
        ("outputs", {"outlier_percent": math.nan}, "Few"),
        ("recording", {"outputs": (ChannelInfo("y", "", math.nan),)}, "Record"),
    ],
)
def test_what_could_not_be_computed_is_not_judged(good, part, change, name):
    check = good.with_(part, **change).check(name)
    assert check.passed is None
    assert check.advice


def test_a_cancellation_of_unknown_uncertainty_is_not_judged(good):
    check = replace(good, model=without_covariance(good.model)).check("Poles")
    assert check.passed is None
    assert check.advice


@pytest.mark.parametrize(
    ("test", "number", "name"),
    [
        ("pairs", "max_in_bounds", "Residuals"),
        ("pairs", "p_value", "Residuals"),
    ],
)
def test_a_correlation_that_could_not_be_computed_is_not_judged(good, test, number, name):
    assert good.with_(test, **{number: math.nan}).check(name).passed is None


def test_a_test_that_could_not_be_computed_is_not_judged(good):
    white = replace(good.validation.outputs[0].ljung_box, p_value=math.nan)
    assert good.with_("outputs", ljung_box=white).check("White").passed is None
    response = replace(good.validation.input_test, p_value=math.nan)
    assert good.with_("validation", input_test=response).check("Response").passed is None


def test_roots_outside_fail(good):
    a, c = np.array([1.0, -1.2]), np.array([1.0, 1.0])
    model = with_polynomials(good.model, a, np.array([1.0]), c, None)
    for name, radius in (("Stable", "1.20000"), ("Invertible", "1.00000")):
        check = replace(good, model=model).check(name)
        assert check.passed is False
        assert radius in check.statement
        assert check.advice


def test_polynomials_without_roots_pass(good):
    one = np.array([1.0])
    model = with_polynomials(good.model, one, np.array([2.0]), one, None)
    for name in ("Stable", "Invertible", "Poles"):
        assert replace(good, model=model).check(name).passed is True


@pytest.mark.parametrize(("share", "passed"), [(0.90, False), (0.94, True)])
def test_whiteness_by_share(good, share, passed):
    changed = good.with_("outputs", autocorrelation_share_inside95=share)
    assert changed.check("White").passed is passed


def test_whiteness_by_ljung_box(good):
    changed = replace(good.validation.outputs[0].ljung_box, p_value=1e-5)
    check = good.with_("outputs", ljung_box=changed).check("White")
    assert check.passed is False
    assert "p < 0.0001" in check.statement


def test_several_outputs_and_pairs_are_judged_together(good):
    """Bonferroni: each of two tests has half of the level, and what fails is named."""
    (output,), (pair,) = good.validation.outputs, good.validation.pairs
    near = replace(output, name="b", ljung_box=replace(output.ljung_box, p_value=0.006))
    assert good.with_("outputs", ljung_box=near.ljung_box).check("White").passed is False
    both = good.with_("validation", outputs=(output, near))
    assert both.check("White").passed is True
    low = replace(near, ljung_box=replace(near.ljung_box, p_value=0.004))
    check = good.with_("validation", outputs=(output, low)).check("White")
    assert check.passed is False
    assert check.statement.endswith("Coloured: b.")
    large = replace(pair, output="b", input="v", max_in_bounds=4.0)
    check = good.with_("validation", pairs=(pair, large)).check("Residuals")
    assert check.passed is False
    assert check.statement.endswith("Dependent: b with v.")
    low = replace(pair, output="b", p_value=0.006)
    for pairs, passed in (((low,), False), ((pair, low), True)):
        assert good.with_("validation", pairs=pairs).check("Residuals").passed is passed


def test_a_pole_of_several_inputs_cancels_where_each_has_a_zero_there():
    one, near = np.array([1.0, -0.5]), np.array([1.0, -0.501])
    for second, cancels in ((np.array([1.0, 0.9]), False), (near, True)):
        model = PolynomialModel(
            one,
            (near, second),
            nk=(1, 1),
            covariance=covariance_of_matrix(1e-4 * np.eye(5)),
        )
        assert bool(cancelling_pairs(model, model.covariance)) is cancels


def test_one_large_cross_correlation_fails(good):
    check = good.with_("pairs", max_in_bounds=4.0).check("Residuals")
    assert check.passed is False
    assert "orders.nb" in check.advice


def test_largest_of_many_cross_correlations_fails_good_models_rarely(good):
    """Of independent white pairs 1 % exceed the allowed maximum, few the sum of squares."""
    rng = np.random.default_rng(1)
    failed = 0
    for _ in range(300):
        found = correlation_with_input(rng.normal(size=1500), rng.normal(size=1500), 200)
        check = good.with_("pairs", p_value=found.p_value, max_in_bounds=found.largest_ratio).check(
            "Residuals"
        )
        failed += check.passed is False
    assert failed <= 10  # expectation 3; more than 10 has a probability below 0.1 %


def test_a_missed_peak_is_named(good):
    check = with_peaks(good, [FREQUENCY, 0.4]).check("Every")
    assert check.passed is False
    assert "0.4 Hz" in check.statement
    assert check.statement.startswith("1 of 2")


@pytest.mark.parametrize(("damping", "error"), [(0.84, 0.001), (0.4, 0.2), (0.4, math.inf)])
def test_a_broad_or_uncertain_mode_does_not_account_for_every_peak(good, damping, error):
    mode = Mode(FREQUENCY, damping, POLES[0], frequency_se_hz=error)
    changed = with_peaks(good.with_("model", modes=(mode,)), [1.3 * FREQUENCY])
    assert changed.check("Every").passed is False


@pytest.mark.parametrize(
    ("excess", "passed"), [(2.9, True), (3.1, False), (math.nan, False), (math.inf, False)]
)
def test_a_peak_without_a_mode_may_follow_from_the_model(good, excess, passed):
    """Zeros and heavy damping put a maximum of the gain away from any mode."""
    assert with_peaks(good, [0.4], excess).check("Every").passed is passed


def test_lines_of_a_periodic_input_are_not_taken_for_modes(good):
    jitter = np.random.default_rng(3).uniform(-0.1, 0.1, 60)
    check = with_peaks(good, [k + j for k, j in enumerate(jitter, start=1)]).check("Every")
    assert check.passed is None
    assert "60 peaks about" in check.statement


def test_many_uneven_peaks_are_judged_and_not_all_listed(good):
    check = with_peaks(good, [1.3**k for k in range(1, 16)]).check("Every")
    assert check.passed is False
    assert "and 9 more" in check.statement


def test_a_spectrum_without_peaks_misses_none(good):
    check = with_peaks(good, []).check("Every")
    assert check.passed is True
    assert "no distinct peaks" in check.statement


@pytest.mark.parametrize(("variance", "passed"), [(1e-8, True), (1e-2, False)])
def test_cancellation_is_judged_by_uncertainty(good, variance, passed):
    # A real pole at 0.5 with a zero 0.02 away from it.
    a, b = np.real(np.poly([*POLES, 0.5])), np.array([1.0, -0.52])
    model = with_polynomials(good.model, a, b, np.array([1.0, 0.4]), variance * np.eye(6))
    assert replace(good, model=model).check("Poles").passed is passed


@pytest.mark.parametrize(("variance", "passed"), [(1e-10, True), (1e-4, False)])
def test_complex_cancellation(good, variance, passed):
    b = np.real(np.poly(np.array(POLES) * 1.01))
    model = with_polynomials(
        good.model, good.model.model.A, b, np.array([1.0]), variance * np.eye(5)
    )
    assert replace(good, model=model).check("Poles").passed is passed


def test_coincident_roots_fail_even_without_covariance(good):
    b = np.real(np.poly(np.array(POLES) * 1.0001))
    model = with_polynomials(good.model, good.model.model.A, b, np.array([1.0, 0.4]), None)
    assert replace(good, model=model).check("Poles").passed is False


@pytest.mark.parametrize(
    ("phase", "order", "value", "passed"),
    [
        ("delay", "nk", 3, False),
        ("delay", "nk", 0, True),  # no delay can be shorter
        ("plant", "na", 5, False),
        ("plant", "na", 2, False),
        ("nc", "nc", 5, False),
        ("nb", "nb", 4, True),
    ],
)
def test_ends_of_the_ranges(good, phase, order, value, passed):
    selection = good.phases[phase]
    tried = [candidate.orders for candidate in selection.candidates]
    selected = replace(selection.orders, **{order: value})
    check = with_phase(good, phase, tried, selected).check("Orders")
    assert check.passed is passed
    assert f"{order} = {value}" in check.statement


def test_orders_that_are_all_fixed_are_not_judged(good):
    for phase in good.phases:
        good = with_phase(good, phase, [armax_orders(3, 3, 3, 1)], armax_orders(3, 3, 3, 1))
    assert good.check("Orders").passed is None


def test_a_root_at_the_stability_bound_fails(good):
    changed = good.with_("model", search=replace(good.model.search, at_stability_bound=True))
    check = changed.check("Roots inside the stability bound")
    assert check.passed is False
    assert f"{good.model.search.settings.max_root_radius:g}" in check.statement
    assert check.advice
    settings = replace(good.model.search.settings, max_root_radius=1.0 - 1e-7)
    near = replace(good.model.search, settings=settings, at_stability_bound=True)
    check = good.with_("model", search=near).check("Roots inside the stability bound")
    assert "(radius 0.9999999)" in check.statement


def test_a_root_at_the_stability_bound_of_the_noise_model_alone_is_a_caution(good):
    search, largest = good.model.search, float(np.max(np.abs(good.model.poles)))
    for bound, word in ((search.settings.max_root_radius, "Caution"), (largest, "Failed")):
        settings = replace(search.settings, max_root_radius=bound)
        at_bound = replace(search, settings=settings, at_stability_bound=True)
        check = good.with_("model", search=at_bound).check("Roots inside the stability bound")
        assert check.word == word
        assert ("No pole of the response" in check.statement) == (word == "Caution")
        assert check.statement.startswith(
            f"A root of {'C' if word == 'Caution' else 'A or C'} lies"
        )


SPARE = {"supported": False}
FIVE_AGREE = {"restart_minima": (1.0,) * 5, "n_confirming": 4}


@pytest.mark.parametrize(
    ("changes", "passed", "statement"),
    [
        ({"restart_minima": (1.0,), "n_confirming": 0, "n_multistart": 0}, None, "one restart"),
        ({"n_confirming": 0}, False, "Not certified: none of 2 other independent restarts"),
        ({"undiscovered_probability": 0.0076}, False, "Not certified: 1 of 2 other independent"),
        ({"undiscovered_probability": 0.0075}, True, "Certified: 1 of 2 other independent"),
        ({"restart_minima": (1.0, 1.0)}, True, "1 of 1 other independent restart reached"),
        ({"undiscovered_probability": 0.05, **FIVE_AGREE}, True, "Certified: 4 of 4 other"),
        ({"undiscovered_probability": 1.0, **FIVE_AGREE}, True, "Certified: 4 of 4 other"),
        (
            {"undiscovered_probability": 0.16, "n_multistart": 32, **SPARE, **FIVE_AGREE},
            True,
            "with probability 0.16 a further descent from a random point leads to one that was not",
        ),
        (
            {"undiscovered_probability": 1.0, "n_multistart": 0, **SPARE, **FIVE_AGREE},
            True,
            "Repeatable, but not certified: 4 of 4 other independent restarts reached the lowest",
        ),
        (
            {
                "restart_minima": (1.0,) * 4,
                "n_confirming": 3,
                "undiscovered_probability": 1,
                **SPARE,
            },
            False,
            "3 of 3 other independent restarts reached the lowest minimum that was found, too few",
        ),
        (
            {"undiscovered_probability": 0.16, "restart_minima": (1.0,) * 5 + (1.1,)},
            False,
            "Not certified: 1 of 5 other",
        ),
    ],
)
def test_a_search_is_repeatable_with_a_certificate_or_where_every_restart_agrees(
    good, changes, passed, statement
):
    check = with_diagnostics(good, **changes).check("Search")
    assert check.passed is passed
    assert statement in check.statement
    assert bool(check.advice) == (passed is not True)


def test_a_certificate_states_the_rate_of_its_own_kind_of_search(good):
    found = with_diagnostics(good, undiscovered_probability=0.01, **FIVE_AGREE)
    states = found.with_("model", orders=None)
    for given, measured in ((found, POLYNOMIALS), (states, STATE_SPACE)):
        evidence = Evidence(given.model, given.validation, given.recording)
        statement = repeatability(evidence).statement
        assert f"Of {measured.certified} such searches" in statement
        assert f"at most {100 * measured.largest_error_rate:.2g} %" in statement


def test_weak_excitation_fails(good):
    changed = good.with_("inputs", excitation_order=2)
    assert changed.check("Excitation").passed is False


@pytest.mark.parametrize(
    ("objective", "percent", "passed"),
    [
        ("quadratic", 0.1, True),
        ("quadratic", 0.2, False),
        ("absolute", 5.0, True),
        ("absolute", 6.0, False),
    ],
)
def test_outliers_are_judged_by_the_objective(good, objective, percent, passed):
    search = good.model.search
    settings = replace(search.settings, objective=objective)
    changed = good.with_("model", search=replace(search, settings=settings))
    check = changed.with_("outputs", outlier_percent=percent).check("Few")
    assert check.passed is passed
    assert ("“absolute”" in check.advice) == (not passed and objective == "quadratic")


@pytest.mark.parametrize(("p_value", "passed"), [(0.009, True), (0.011, False)])
def test_the_response_to_the_input_is_judged_at_one_percent(good, p_value, passed):
    test = replace(good.validation.input_test, coefficient=0.3, p_value=p_value)
    check = good.with_("validation", input_test=test).check("Response")
    assert check.passed is passed
    assert f"coefficient 0.3, p = {p_value:.2g}." in check.statement


def of_three_inputs(evidence):
    """The same with orders of three inputs."""
    o = evidence.model.orders
    return evidence.with_("model", orders=replace(o, nb=o.nb * 3, nk=o.nk * 3, nf=o.nf * 3))


def test_an_input_of_several_that_explains_nothing_is_named(good):
    (source,) = good.validation.inputs
    told = replace(good.validation.input_test, coefficient=0.9, p_value=1e-9)
    inputs = [replace(source, name=f"u{k}", test=told) for k in (1, 2, 3)]
    inputs[1] = replace(inputs[1], test=replace(told, p_value=0.2))
    several = of_three_inputs(good).with_("validation", inputs=tuple(inputs), input_test=told)
    check = several.check("Every input")
    assert (check.passed, check.grade) == (False, "caution")
    assert "the response to u2 (p = 0.2) does not differ from zero" in check.statement
    kept = several.with_("validation", inputs=(inputs[0], inputs[2], inputs[0]))
    assert kept.check("Every input").passed is True
    # Where all inputs together explain nothing, that is said alone.
    nothing = several.with_("validation", input_test=replace(told, p_value=0.5))
    assert not [each for each in nothing.checks if each.name.startswith("Every input")]


def test_inputs_that_hide_each_others_response_fail(good):
    (source,) = good.validation.inputs
    inputs = [replace(source, name=f"u{k}") for k in (1, 2, 3)]
    several = of_three_inputs(good)
    assert several.with_("validation", inputs=tuple(inputs)).check("Inputs told").passed is True
    inputs[::2] = [replace(each, hidden_hz=((0.5, 15.0),)) for each in inputs[::2]]
    check = several.with_("validation", inputs=tuple(inputs)).check("Inputs told")
    assert (check.passed, check.grade) == (False, "defect")
    assert check.statement.startswith("u1, u3 cannot be distinguished at 0.5 to 15 Hz")


def test_a_validation_input_with_power_elsewhere_fails(good):
    split = replace(
        good.validation.inputs[0].split,
        share_outside=0.62,
        bands_hz=((20.0, 31.5),),
        comparable=False,
    )
    check = good.with_("inputs", split=split).check("Validation input")
    assert check.passed is False
    assert check.statement.startswith("62 % of the power of the validation input")
    assert "(20 to 31.5 Hz)" in check.statement
    unknown = replace(split, comparable=None)
    assert good.with_("inputs", split=unknown).check("Validation input").passed is None


def test_a_saturated_channel_is_named(good):
    check = good.with_("recording", outputs=(ChannelInfo("y", "", 3.0),)).check("Record")
    assert check.passed is False
    assert check.statement.startswith("3 % of the output is saturated")


def test_a_peak_that_a_model_without_noise_model_lacks_is_a_caution(good):
    peaked = with_peaks(good, [0.4])
    assert peaked.check("Every").word == "Failed"
    silent = peaked.with_("model", structure="oe").check("Every")
    assert (silent.passed, silent.word) == (False, "Caution")


def test_root_gradient_against_finite_differences():
    coefficients = np.array([1.0, -1.5, 0.9, -0.2])
    for root in np.roots(coefficients):
        gradient = root_gradient(coefficients, root)
        for i in range(coefficients.size):
            moved = []
            for step in (1e-6, -1e-6):
                changed = coefficients.copy()
                changed[i] += step
                roots = np.roots(changed)
                moved.append(roots[np.argmin(np.abs(roots - root))])
            assert gradient[i] == pytest.approx((moved[0] - moved[1]) / 2e-6, rel=1e-5, abs=1e-7)


def test_root_covariance_by_monte_carlo():
    rng = np.random.default_rng(2)
    a = np.real(np.poly(POLES))
    matrix = 1e-6 * np.array([[2.0, 0.5], [0.5, 1.0]])
    drawn = rng.multivariate_normal(a[1:], matrix, size=20_000)
    # The roots of z² + a1 z + a2 in closed form.
    roots = (-drawn[:, 0] + np.sqrt(drawn[:, 0] ** 2 - 4 * drawn[:, 1] + 0j)) / 2
    sampled = np.cov(roots.real, np.abs(roots.imag))
    spread = root_covariance(a, POLES[0], covariance_of_matrix(matrix))
    np.testing.assert_allclose(spread, sampled, rtol=0.05)


def test_root_covariance_of_a_polynomial_that_is_not_monic():
    # The root of b0 z + b1 is −b1/b0, its variance by propagation (var b1 + r² var b0) / b0².
    b = np.array([2.0, -1.0])
    spread = root_covariance(b, 0.5, covariance_of_matrix(np.diag([0.01, 0.04])))
    np.testing.assert_allclose(spread, [[(0.04 + 0.25 * 0.01) / 4, 0.0], [0.0, 0.0]])


def test_a_failed_test_of_the_class_says_when_and_what_kind(good):
    failed = ResidualTest(1e-6, 0.05)

    def said(name, **fields):
        tests = replace(good.validation.model_class, **fields)
        return good.with_("validation", model_class=tests).check(name).statement

    rate = good.model.sampling_rate
    sudden = said("Constant in time", constant=failed, changed_at=250.0)
    assert f"One sudden change explains it, about {250.0 / rate:.3g} s" in sudden
    assert "gradual" in said("Constant in time", constant=failed, changed_at=0.0)
    waves = said("Constant in time", constant=failed, changed_at=0.0, period=250.0)
    assert f"The change comes back about every {250.0 / rate:.3g} s" in waves
    unsought = said("Constant in time", constant=failed)
    assert "sudden" not in unsought
    assert "gradual" not in unsought
    assert "polynomials or waves in time" in unsought
    assert "on polynomials in time" in said("Constant in time", constant=failed, period=0.0)
    powers = (0.01, 0.02, 0.01, 0.3)
    assert "Cubes of the inputs" in said("Linear", linear=failed, powers=powers)
    assert "cubes of the response and of the inputs:" in said("Linear")
    for name in ("Linear", "Constant in time"):
        statement = good.with_("validation", inputs=[]).check(name).statement
        assert "of the output before:" in statement or "by the output before:" in statement


@pytest.mark.parametrize(("error", "noise"), [(1e-12, False), (1e-6, True), (math.nan, True)])
def test_rounding_errors_are_no_noise_to_test(good, error, noise):
    """Single precision leaves 1e-6 %."""
    failed = ResidualTest(1e-6, 0.05)
    tests = replace(good.validation.model_class, constant=failed, linear=failed)
    given = good.with_("validation", model_class=tests, prediction_error_percent=error)
    given = given.with_("outputs", autocorrelation_share_inside95=math.nan, outlier_percent=40.0)
    for name in ("White", "Residuals independent", "Constant", "Linear", "Free", "Few residual"):
        found = given.check(name)
        assert ("There is no noise" in found.statement) is not noise
        assert found.passed or noise
    assert given.check("White").passed is (None if noise else True)
    assert given.check("Linear").passed is not noise


def test_feedback_on_the_same_sample_is_not_told_of_a_model_without_delay(good):
    """A white disturbance in u = r - K y is then one of the response; the joint process is one."""
    assert good.with_("inputs", may_follow=True).check("Free").passed
    direct = good.with_("model", orders=armax_orders(3, 3, 3, 0))
    assert direct.with_("inputs", may_follow=False).check("Free").passed
    found = direct.with_("inputs", may_follow=True).check("Free")
    assert found.passed is None
    assert found.statement.endswith("is not told from a response without delay.")


@pytest.mark.parametrize(
    ("follows", "follower", "cause"),
    [
        ("constant", "Constant in time", "Linear"),
        ("linear", "Linear", "Constant in time"),
        ("feedback", "Constant in time", "Free of feedback"),
    ],
)
def test_one_cause_of_two_failed_checks_counts_once(good, follows, follower, cause):
    failed = ResidualTest(1e-6, 0.05)
    tests = replace(good.validation.model_class, constant=failed, linear=failed)
    tests = replace(tests, without_feedback=failed)
    assert good.with_("validation", model_class=tests).check(follower).word == "Failed"
    judged = good.with_("validation", model_class=replace(tests, follows=follows))
    followed = judged.check(follower)
    assert (followed.word, followed.follows_from) == ("Caution", cause)
    assert re.match(f"Follows from “{cause}”: .*beside ", followed.statement)
    assert judged.check(cause).word == "Failed"
    names = [check.name for check in judged.checks]
    assert names.index(follower) == names.index(cause) + 1


def test_what_a_response_lacks_that_is_not_there_counts_once(good):
    tests = replace(good.validation.model_class, linear=ResidualTest(1e-6, 0.05))
    given = good.with_("validation", model_class=tests).with_("pairs", p_value=1e-3)
    assert [check.name for check in failed_checks(given.checks)] == [
        "Residuals independent of the input",
        "Linear",
    ]
    test = replace(good.validation.input_test, p_value=0.5)
    (failed,) = failed_checks(given.with_("validation", input_test=test).checks)
    assert failed.name == "Response to the input significant"


@pytest.mark.parametrize("failing", ["linear", "constant", "without_feedback"])
@pytest.mark.parametrize("revisions", [None, 0, 3])
def test_residuals_follow_from_a_wrong_class_where_no_revision_mended_them(
    good, failing, revisions
):
    name = "Residuals independent of the input"
    tests = replace(good.validation.model_class, **{failing: ResidualTest(1e-6, 0.05)})
    given = good.with_("validation", model_class=tests).with_("pairs", p_value=1e-3)
    revised = None if revisions is None else (f"White residuals and {name}",) * revisions
    judged = checks(Evidence(given.model, given.validation, given.recording, (), revised))
    (found,) = [check for check in judged if check.name == name]
    follows = bool(revisions) and failing != "without_feedback"
    assert found.word == ("Caution" if follows else "Failed")
    assert ("no model tried against it (3) did as well" in found.statement) == follows
    assert len(failed_checks(judged)) == 2 - follows


def test_thousands_are_set_apart(good):
    assert "1\u202f200 autocorrelations" in good.check("White residuals").statement
    assert "401 cross-correlations" in good.check("Residuals independent").statement


@pytest.mark.parametrize("coloured", [True, False])
def test_a_peak_follows_where_coloured_residuals_do(good, coloured):
    tests = replace(good.validation.model_class, linear=ResidualTest(1e-6, 0.05))
    given = with_peaks(good, [0.4]).with_("validation", model_class=tests)
    if coloured:
        given = given.with_("outputs", autocorrelation_share_inside95=0.5)
    revised = ("White residuals",) * 3
    judged = checks(Evidence(given.model, given.validation, given.recording, (), revised))
    (peaks,) = [check for check in judged if check.name == "Every spectral peak modelled"]
    assert peaks.follows_from == ("Linear" if coloured else "")
    assert ("Follows from “Linear”, as the coloured residuals do:" in peaks.statement) == coloured
    assert [check.name for check in failed_checks(judged)] == ["Linear", peaks.name][: 2 - coloured]


def test_a_model_at_the_floor_names_what_no_linear_model_removes(good):
    floor = Floor("y", 10.0, Part(9.8, 9.5, 10.0), Part(2.0, 0.0, 3.0))
    tests = replace(good.validation.model_class, linear=ResidualTest(1e-6, 0.05))
    failed = good.with_("validation", model_class=tests)
    assert "No linear model" not in failed.check("Linear").statement
    at_floor = failed.with_("validation", floors=(floor,))
    assert "No linear model does much better" in at_floor.check("Linear").statement
    assert at_floor.check("Linear").grade == "caution"


@pytest.mark.parametrize(("p_value", "shown"), [(1e-6, True), (0.3, False)])
@pytest.mark.parametrize("rest", [2.0, 6.0])
def test_failed_tests_of_residuals_name_distortion_that_is_shown(good, p_value, shown, rest):
    parts = ErrorParts("y", 6.4, Part(1, 1, 1), Part(4.9, 4.0, 5.8), Part(rest, rest, rest))
    found = Distortion("", "validation", 64, 3, 1, p_value, False, (parts,))
    correlated = good.with_("pairs", p_value=1e-3)
    assert "istortion" not in correlated.check("Residuals independent").statement
    assert good.with_("validation", distortion=found).checks == good.checks
    failed = correlated.with_("validation", distortion=found).check("Residuals independent")
    assert failed.passed is False
    assert ("Nonlinear distortion, at least 4.9 %" in failed.statement) is shown
    prevails = shown and rest < 4.9
    assert ("not to blame" in failed.advice) is prevails
    assert failed.grade == ("caution" if prevails else "defect")


def test_the_faq_has_every_check_with_its_grade():
    page = (ROOT / "docs" / "failed_checks.md").read_text(encoding="utf-8")
    rows = re.findall(r"^\| (caution|note) \| .* \| (.*) \|$", page, re.MULTILINE)
    graded = {name: grade for grade, names in rows for name in names.split(", ")}
    assert graded == {judge.name: judge.grade for judge in CHECKS if judge.grade != "defect"}
