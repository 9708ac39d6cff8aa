"""The verdict follows from the errors, the checks and the modes, and says what it rests on."""

import hashlib
import json
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pandas as pd
import pytest
from by_scores import chosen_by_scores
from identified import with_model, with_outcome, without_modes
from jsonschema import Draft202012Validator

import evopem
from evopem.automatic.decision import DecisionRecord
from evopem.config.schema import schema_file
from evopem.files.json_form import to_json
from evopem.models.polynomial import PolynomialModel
from evopem.report.results_text import delay_words
from evopem.report.verdict import DESIRABLE, ESSENTIAL, mode_lines, verdict
from evopem.report.verdict_file import verdict_file
from evopem.results.dataset import DatasetResults, ResponseErrors, StatedDelay
from evopem.results.fleet import summarize
from evopem.validation.checks import CHECKS, Check
from evopem.validation.distortion import Distortion, Floor
from evopem.validation.error_parts import ErrorParts, Part
from evopem.validation.frequency_responses import SPEAK_AGAINST
from evopem.validation.held_out_tests import NO_TEST
from evopem.validation.mode_evidence import doubts

SMALL = {"simulation_error_percent": 5.0, "prediction_error_percent": 5.0}


def with_checks(monkeypatch, results, grade="defect", **outcomes):
    """Every check passed, but those whose outcome is given by name."""
    named = {name.replace("_", " "): passed for name, passed in outcomes.items()}
    listed = [
        Check(c.name, named.get(c.name, True), c.statement, grade=grade) for c in results.checks
    ]
    monkeypatch.setattr(type(results), "checks", property(lambda _: listed))


def answers(found):
    return {use.name: use.answer for use in found.uses}


def test_the_checks_that_a_verdict_rests_on_exist():
    names = {judge.name for judge in CHECKS}
    assert ESSENTIAL.keys() | DESIRABLE.keys() <= names | SPEAK_AGAINST.keys()


@pytest.mark.parametrize(
    ("error", "answer"), [(10.0, "good"), (45.0, "care"), (80.0, "no"), (np.nan, "no")]
)
def test_the_error_of_the_simulation_decides(results, monkeypatch, error, answer):
    with_checks(monkeypatch, results)
    found = verdict(with_outcome(results, simulation_error_percent=error))
    assert answers(found)["simulation of the transformed output"] == answer
    (use,) = [u for u in found.uses if u.name == "simulation of the transformed output"]
    assert ("off by" in use.reason) == np.isfinite(error)
    (modes,) = [use for use in found.uses if use.key == "modes"]
    assert modes.answer == ("care" if error == 80.0 else "good")
    assert ("simulations are off by 80" in modes.reason) == (error == 80.0)


@pytest.mark.parametrize(
    ("check", "passed", "use", "answer"),
    [
        ("Stable", False, "the frequency response", "no"),
        ("White_residuals", False, "one-step prediction", "care"),
        ("White_residuals", False, "the frequency response", "care"),
        ("White_residuals", None, "standard errors", "care"),
        ("Residuals_independent_of_the_input", False, "the frequency response", "care"),
        ("Roots_inside_the_stability_bound", False, "standard errors", "no"),
        ("Response_to_the_input_significant", False, "simulation of the transformed output", "no"),
        ("Response_to_the_input_significant", False, "standard errors", "no"),
        ("Free_of_feedback", False, "standard errors", "no"),
        ("Free_of_feedback", False, "the frequency response", "no"),
        ("Record_not_saturated", False, "the modes at 5.35, 16.5 and 37\u202fHz", "care"),
        ("Record_not_saturated", False, "standard errors", "no"),
        ("Constant_in_time", False, "the modes at 5.35, 16.5 and 37\u202fHz", "care"),
    ],
)
def test_a_check_that_did_not_pass_takes_its_uses_away(
    results, monkeypatch, check, passed, use, answer
):
    with_checks(monkeypatch, results)
    before = answers(verdict(with_outcome(results, **SMALL)))
    assert before[use] == "good"
    with_checks(monkeypatch, results, **{check: passed})
    found = verdict(with_outcome(results, **SMALL))
    assert answers(found)[use] == answer
    (named,) = [each for each in found.uses if each.name == use]
    assert f"“{check.replace('_', ' ')}”" in named.reason


@pytest.mark.parametrize(
    ("check", "grade", "answer"),
    [
        ("Search_repeatable", "note", "good"),
        ("Orders_inside_their_search_ranges", "note", "good"),
        ("White_residuals", "note", "good"),
        ("White_residuals", "caution", "care"),
        ("White_residuals", "defect", "care"),
    ],
)
def test_a_verdict_follows_the_kind_of_a_check(results, monkeypatch, check, grade, answer):
    """What the user's own range or the search limits is no fault of the model."""
    with_checks(monkeypatch, results, grade, **{check: False})
    found = verdict(with_outcome(results, **SMALL))
    assert answers(found)["one-step prediction"] == answers(found)["standard errors"] == answer
    if answer == "care":
        word = "caution" if grade == "caution" else "failed"
        reasons = {use.name: use.reason for use in found.uses}
        assert f"{word}: “White residuals”" in reasons["standard errors"]


@pytest.mark.parametrize(("grade", "answer"), [("caution", "care"), ("defect", "no")])
def test_a_check_that_follows_speaks_as_its_cause_does(results, monkeypatch, grade, answer):
    """Distortion that no linear model removes is no fault, nor is what follows from it."""
    with_checks(monkeypatch, results, grade, Linear=False, Constant_in_time=False)
    listed = [
        replace(check, grade="caution", follows_from="Linear")
        if "Constant" in check.name
        else check
        for check in results.checks
    ]
    monkeypatch.setattr(type(results), "checks", property(lambda _: listed))
    assert answers(verdict(results))["standard errors"] == answer


@pytest.mark.parametrize("error", [100.0, 333.0])
def test_a_model_no_better_than_the_mean_is_good_for_nothing_that_it_computes(
    results, monkeypatch, error
):
    with_checks(monkeypatch, results)
    of_both = {"prediction_error_percent": error, "simulation_error_percent": error}
    uses = {use.name: use for use in verdict(with_outcome(results, **of_both)).uses}
    for name in ("one-step prediction", "simulation of the transformed output"):
        assert uses[name].answer == "no"
    assert uses["the frequency response"].answer == "no"
    assert "no better than the mean" in uses["the frequency response"].reason
    of_prediction = with_outcome(results, prediction_error_percent=error)
    assert answers(verdict(of_prediction))["one-step prediction"] == "no"
    assert answers(verdict(of_prediction))["the frequency response"] == "good"


@pytest.mark.parametrize(
    ("error", "answer"), [(59.0, "good"), (61.0, "care"), (99.0, "care"), (100.0, "no")]
)
def test_a_prediction_is_good_up_to_sixty_percent(results, monkeypatch, error, answer):
    with_checks(monkeypatch, results)
    both = dict.fromkeys(("prediction_error_percent", "simulation_error_percent"), error)
    found = verdict(with_outcome(results, **both))
    assert answers(found)["one-step prediction"] == answer


def test_a_prediction_worse_than_the_simulation_is_given_with_care(results, monkeypatch):
    with_checks(monkeypatch, results)
    for error, answer in ((10.5, "good"), (12.0, "care")):
        changed = with_outcome(
            results, prediction_error_percent=error, simulation_error_percent=10.0
        )
        (use,) = [use for use in verdict(changed).uses if use.key == "prediction"]
        assert use.answer == answer
        assert ("a simulation, without past outputs, by 10.0" in use.reason) == (answer == "care")


def test_a_response_whose_simulation_or_band_is_poor_is_given_with_care(results, monkeypatch):
    """Bands hold the errors of the coefficients, not what a model leaves out of the response."""
    with_checks(monkeypatch, results)

    def response(found):
        return next(use for use in verdict(found).uses if use.name == "the frequency response")

    assert response(with_outcome(results, simulation_error_percent=59.0)).answer == "good"
    poor = response(with_outcome(results, simulation_error_percent=85.0))
    assert poor.answer == "care"
    assert "hides errors of the gain" in poor.reason
    table = results.frequency_response
    wide = table.assign(gain_lower=0.7 * table["gain"], gain_upper=1.3 * table["gain"])
    assert response(replace(results, frequency_response=wide)).answer == "care"
    # One of three pairs that is known little is not hidden behind the others.
    pairs = [table, table.assign(output="second"), wide.assign(output="third")]
    assert response(replace(results, frequency_response=pd.concat(pairs))).answer == "care"
    assert response(replace(results, frequency_response=pd.concat(pairs[:2]))).answer == "good"
    # At 0 Hz a record without its mean tells nothing.
    at_zero, largest = table["frequency_hz"] == 0.0, 1e4 * table["gain"].max()
    assert at_zero.any()
    unknown = table.assign(gain_upper=table["gain_upper"].mask(at_zero, largest))
    assert response(replace(results, frequency_response=unknown)).answer == "good"


def test_intervals_after_an_automatic_choice_are_given_with_care(results, monkeypatch):
    """Measured coverage after a choice of structure and orders is below 95 %."""
    with_checks(monkeypatch, results)
    record = DecisionRecord("simulation", (), (), (), (), None)
    found = verdict(chosen_by_scores(results, record))
    (use,) = [use for use in found.uses if use.name == "standard errors"]
    assert use.answer == "care"
    assert "take the chosen orders for the true ones" in use.reason
    alone = chosen_by_scores(results, record, tried=1)
    assert answers(verdict(alone))["standard errors"] == "good"


def test_standard_errors_without_noise_are_given_with_care(results, monkeypatch):
    with_checks(monkeypatch, results)
    exact = replace(results.validation, prediction_error_percent=1e-13)
    (use,) = [u for u in verdict(replace(results, validation=exact)).uses if "errors" in u.name]
    assert (use.answer, use.reason) == ("care", "there is no noise that they would come from")


def test_rounding_errors_are_not_called_coloured(results, monkeypatch):
    with_checks(monkeypatch, results)
    test = replace(results.validation.outputs[0].ljung_box, p_value=1e-9)
    coloured = with_outcome(of_structure(results, "oe"), outputs={"ljung_box": test})
    for error, answer in ((1e-6, "care"), (1e-13, "good")):
        found = verdict(with_outcome(coloured, prediction_error_percent=error))
        assert answers(found)["one-step prediction"] == answer


def test_the_sentence_names_every_use_with_its_answer(results):
    found = verdict(results)
    good = ", ".join(use.name for use in found.of("good")[:-1])
    assert found.sentence.startswith(f"Good for {good}")
    for use in found.uses:
        assert use.name in found.sentence
    assert [use.answer for use in found.uses] == sorted(
        (use.answer for use in found.uses), key=("good", "care", "no").index
    )


def of_structure(results, structure):
    """The results as if the model had another structure."""
    return replace(results, model=replace(results.model, structure=structure))


def test_without_a_noise_model_a_prediction_is_as_good_as_the_simulation(results, monkeypatch):
    with_checks(monkeypatch, results)
    output_error = of_structure(results, "oe")
    white = replace(results.validation.outputs[0].ljung_box, p_value=0.5)
    coloured = replace(white, p_value=1e-9)
    for error, test, answer in (
        (10.0, white, "good"),
        (80.0, white, "no"),
        (10.0, coloured, "care"),
    ):
        of_output = {"ljung_box": test, "autocorrelation_share_inside95": 0.95}
        found = verdict(
            with_outcome(output_error, outputs=of_output, prediction_error_percent=error)
        )
        assert answers(found)["one-step prediction"] == answer
        assert answers(found)["standard errors"] == "good"
    reasons = {use.name: use.reason for use in found.uses}
    assert "no noise model" in reasons["one-step prediction"]
    assert "colour" in reasons["standard errors"]


def test_a_model_without_input_is_judged_by_prediction_and_spectrum(results, monkeypatch):
    with_checks(monkeypatch, results)
    known = results.model.polynomials
    noise = PolynomialModel(known.A, (), known.C, sampling_rate=known.sampling_rate)
    alone = replace(
        results,
        model=with_model(results.model, noise),
        frequency_response=results.frequency_response.assign(gain=np.nan),
    )
    found = answers(verdict(alone))
    assert not [name for name in found if "simulation" in name or "response" in name]
    assert found["one-step prediction"] == found["the spectrum of the output"] == "good"


def test_an_untransformed_output_has_one_simulation(results):
    record = results.model
    plain = replace(record.transforms, box_cox=None, difference=0)
    found = verdict(replace(results, model=replace(record, transforms=plain)))
    assert [name for name in answers(found) if "simulation" in name] == [
        "simulation from the input"
    ]


def test_an_input_that_rests_tests_no_simulation(results):
    split = replace(results.validation.inputs[0].split, comparable=None)
    resting = with_outcome(results, inputs={"split": split}, input_test=NO_TEST)
    uses = {use.name: use for use in verdict(resting).uses}
    for name in ("simulation of the transformed output", "simulation of the output as recorded"):
        assert uses[name].answer == "no"
        assert uses[name].reason.startswith("not tested: the input does not change")
    outcome = {check.name: check for check in resting.checks}
    for name in ("Response to the input significant", "Validation input comparable"):
        assert outcome[name].passed is None
        assert "the input does not change" in outcome[name].statement.lower()
        assert "second step or blow" in outcome[name].advice


def test_standard_errors_that_are_not_known_are_not_good(results, monkeypatch):
    with_checks(monkeypatch, results)
    assert answers(verdict(results))["standard errors"] == "good"
    one = results.model.parameter_standard_errors.copy()
    one[0] = np.inf
    for errors, answer, reason in (
        (None, "no", "no coefficient has one"),
        (np.full_like(one, np.nan), "no", "no coefficient has one"),
        (one, "care", f"not known of 1 of {one.size} coefficients"),
    ):
        record = replace(results.model, parameter_standard_errors=errors)
        (use,) = [
            each
            for each in verdict(replace(results, model=record)).uses
            if each.name == "standard errors"
        ]
        assert (use.answer, use.reason) == (answer, reason)


def test_prevailing_distortion_is_no_defect_but_takes_the_standard_errors(results, monkeypatch):
    with_checks(monkeypatch, results, "caution", Linear=False)
    assert answers(verdict(results))["standard errors"] == "care"
    parts = ErrorParts("y", 6.4, Part(1, 1, 1), Part(4.9, 4.0, 5.8), Part(2, 2, 2))
    distorted = Distortion("", "validation", 64, 3, 1, 1e-6, True, (parts,))
    found = answers(verdict(with_outcome(results, distortion=distorted)))
    assert found["standard errors"] == "no"
    assert found["the frequency response"] == "care"
    floor = Floor("y", 10.0, Part(9.8, 9.5, 10.0), Part(2.0, 0.0, 3.0))
    assert answers(verdict(with_outcome(results, floors=(floor,))))["standard errors"] == "no"


def test_a_model_without_a_trusted_mode_says_so(results):
    found = verdict(without_modes(results))
    assert answers(found)["modes"] == "no"


def test_a_damping_that_the_record_leaves_open_is_said_with_the_mode(identified, build):
    results = identified.results
    table = results.validation.modes
    at = next(place for place, judged in enumerate(table.modes) if judged.trusted)
    rows = [*table.modes]
    rows[at] = replace(rows[at], mode=replace(rows[at].mode, damping_ratio=1e-6, damping_se=0.04))
    changed = with_outcome(results, modes=replace(table, modes=tuple(rows)))
    (use,) = [use for use in verdict(changed).uses if use.key == "modes"]
    assert use.name.count("damping below 7.8\u202f%") == 1
    written = to_json(verdict_file(changed, summarize(changed.evidence), identified.files))
    limits = [mode["damping_below_percent"] for mode in written["modes"]]
    assert limits.count(None) == len(limits) - 1
    assert limits[at] == pytest.approx(7.84, abs=0.01)
    assert "&lt;\u00a07.8</td>" in build(changed)


@pytest.mark.parametrize(
    ("off", "said"), [(250.0, "by up to a factor of 12"), (1e5, "is not known")]
)
def test_an_error_beyond_all_numbers_is_not_known(results, monkeypatch, off, said):
    errors = ResponseErrors(10.0, off, 5.0)
    monkeypatch.setattr("evopem.report.verdict.response_errors", lambda *_: [errors])
    (use,) = [use for use in verdict(results).uses if use.key == "frequency_response"]
    assert said in use.reason
    assert "–" not in use.reason


def test_nothing_good_is_said_plainly(results, monkeypatch):
    with_checks(
        monkeypatch,
        results,
        Stable=False,
        Invertible=False,
        Roots_inside_the_stability_bound=False,
    )
    assert verdict(without_modes(results)).sentence == (
        "This model is good for nothing that was tested."
    )


def test_every_mode_has_one_line(results):
    lines = mode_lines(results)
    assert [line.mode.pole for line in lines] == [mode.pole for mode in results.model.modes]
    trusted = {mode.pole for mode in results.validation.modes.trusted}
    assert [line.trusted for line in lines] == [line.mode.pole in trusted for line in lines]


def test_reasons_to_doubt_a_mode(results):
    rate = results.model.sampling_rate
    trusted = next(each for each in results.validation.modes.modes if each.trusted)
    assert doubts(trusted, rate) == []

    def of(**changes):
        return doubts(replace(trusted, **changes), rate)

    mode = trusted.mode
    assert of(mode=replace(mode, damping_ratio=0.7)) == ["decays too fast to be a resonance"]
    assert of(mode=replace(mode, damping_ratio=-0.01)) == ["does not decay"]
    assert of(mode=replace(mode, damping_ratio=1e-9)) == []  # the input drives it clearly
    assert of(mode=replace(mode, frequency_se_hz=np.nan)) == ["has no known standard error"]
    assert of(mode=replace(mode, frequency_se_hz=mode.frequency_hz)) == [
        "has a frequency known to no better than 10 % or its bandwidth"
    ]
    wide = replace(mode, frequency_se_hz=0.08 * mode.frequency_hz)
    assert [len(of(mode=replace(wide, damping_ratio=zeta))) for zeta in (0.1, 0.2)] == [1, 0]
    assert of(reached=False, needed_by_noise=False) == [
        "shows neither in the response to the input nor in the noise"
    ]
    assert of(reached=False, needed_by_noise=True) == []
    alone = replace(mode, input_participation=np.empty(0))
    assert of(reached=False, needed_by_noise=False, mode=alone) == [
        "does not improve the prediction of the samples that judge it"
    ]
    few = "could not be tested: few samples judge it, or without power there"
    assert of(reached=None, needed_by_noise=None) == [few]
    compared = {"order": 6, "compared": 4}
    assert of(recurrence=0.5, orders=(4, 5, 6), **compared) == []  # the input drives it clearly
    trusted = replace(trusted, input_test=replace(trusted.input_test, statistic=5.0))
    assert of(mode=replace(mode, damping_ratio=1e-9)) == ["does not decay"]
    assert of(recurrence=0.5, orders=(4, 5, 6), **compared) == [
        "only 2 of the 4 other orders with enough poles share its frequency and damping"
    ]
    assert of(recurrence=0.0, orders=(6,), order=6, compared=1) == [
        "the only other order with enough poles does not share its frequency and damping"
    ]
    # Orders that need all their poles elsewhere are not compared, and may have it all the same.
    assert of(recurrence=0.0, orders=(2, 3, 6), **compared) == [
        "none of the 4 other orders with enough poles share its frequency and damping,"
        " and 2 with fewer do"
    ]
    assert of(recurrence=np.nan) == []


def test_verdict_json_is_of_its_schema_and_says_what_the_results_say(identified):
    files, results = identified.files, identified.results
    written = json.loads(Path(files.verdict).read_text(encoding="utf-8"))
    schema = json.loads(schema_file().with_name("verdict.schema.json").read_text(encoding="utf-8"))
    validator = Draft202012Validator(schema)
    validator.validate(written)
    assert not validator.is_valid(written | {"sentence": None})
    judged = verdict(results)
    assert written["sentence"] == judged.sentence
    assert {use["key"]: use["answer"] for use in written["uses"]} == {
        use.key: use.answer for use in judged.uses
    }
    assert written["defects"] == [check.name for check in results.checks if check.word == "Failed"]
    by_name = {check["name"]: check for check in written["checks"]}
    assert by_name["Orders inside their search ranges"]["passed"] is False
    assert by_name["Orders inside their search ranges"]["grade"] == "note"
    modes = evopem.load(files.model).modes()
    listed = [(mode["frequency_hz"], mode["damping_se_percent"]) for mode in written["modes"]]
    assert listed == [(mode.frequency_hz, 100.0 * mode.damping_se) for mode in modes]
    for name, digest in written["results_sha256"].items():
        content = (Path(files.folder) / name).read_bytes()
        assert hashlib.sha256(content).hexdigest() == digest
    assert {"model.json", "validation.json"} < written["results_sha256"].keys()


def test_the_delay_stands_in_the_first_line_with_those_that_are_likely(results, build):
    (nk,) = results.model.polynomials.orders.nk
    assert results.delays == (StatedDelay("input", nk, None),)
    ms = 1000 * nk / results.model.sampling_rate
    words = f"delay {nk} sample{'' if nk == 1 else 's'} ({ms:.3g} ms)"
    assert delay_words(results) == words
    assert f"</strong>, {words}</p>" in build(results)
    named = (StatedDelay("force", 0, (0,)), StatedDelay("heat", 250, (249, 250, 251)))
    model = SimpleNamespace(sampling_rate=100.0)
    shown = delay_words(SimpleNamespace(model=model, delays=named))
    assert shown == "delays force 0; heat 250 samples (2.5 s), likely 249 to 251"
    many = delay_words(SimpleNamespace(model=model, delays=2 * named))
    assert many == "delays of 0 to 250 samples"


def test_numbers_that_are_not_known_are_null_in_verdict_json(identified):
    results = with_outcome(identified.results, simulation_error_percent=np.nan)
    summary = summarize(results.evidence)
    written = to_json(verdict_file(results, summary, identified.files))
    assert written["simulation_error_percent"] is None
    assert written["prediction_error_percent"] > 0


def test_the_way_back_to_recorded_units_is_named(results, monkeypatch):
    record = results.model
    recorded = replace(results.recorded, simulation_error_percent=80.0, integrations=1)
    for pole, name in ((0.0, "differences"), (0.97, "filter")):
        transforms = replace(record.transforms, difference=1, difference_pole=pole)
        changed = replace(results, model=replace(record, transforms=transforms))
        monkeypatch.setattr(DatasetResults, "recorded", recorded)
        uses = {use.name: use.reason for use in verdict(changed).uses}
        reason = uses["simulation of the output as recorded"]
        assert reason.endswith(f"because undoing the {name} sums up the error")
