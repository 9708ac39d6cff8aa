"""Trends and Box-Cox are taken where held-out simulations gain by them, else not."""

from pathlib import Path

import numpy as np
import pytest
from measured import measured_inputs
from records import output_error_record
from scipy.signal import lfilter

from evopem.automatic.decision import Decision
from evopem.automatic.preparation.plan import PreparationPlan
from evopem.automatic.preparation.transforms import decide_transforms, spread_test
from evopem.config.channels import ChannelSettings
from evopem.config.defaults import complete, yaml_text
from evopem.config.settings import GivenPreparation
from evopem.files.json_form import load
from evopem.pipeline.acquisition import read_recording
from evopem.pipeline.preparation import prepare_samples
from evopem.results.layout import DatasetFiles
from evopem.signals.prepared_data import load_prepared, measured_outputs
from evopem.signals.recording import Segment

SLOPE = 0.03


@pytest.fixture(scope="module")
def record():
    u, y, _ = output_error_record(600, percent=20.0)
    return u, y


def plan_of(u, y, **keys):
    return decide_transforms([Segment(u, y)], [0], **keys)


def decision(plan) -> Decision:
    (about,) = plan.decisions
    return about


def test_a_stationary_record_is_left_as_it_is(record):
    plan = plan_of(*record)
    assert plan.box_cox is None
    assert not plan.has_trend
    assert decision(plan).choice == "none"


def test_the_slope_of_an_output_that_drifts_is_found(record):
    u, y = record
    plan = plan_of(u, y + SLOPE * np.arange(600))
    assert plan.output_trend == pytest.approx(SLOPE, rel=0.05)
    assert np.max(np.abs(plan.input_trends), initial=0.0) < 0.1 * SLOPE
    assert plan.box_cox is None
    none, *removed = (each.score for each in decision(plan).alternatives)
    assert min(removed) < 0.9 * none


def test_a_transform_without_a_gain_in_a_part_is_not_scored_on_the_others(record):
    u, y = record
    plan = plan_of(u, y + SLOPE * np.maximum(np.arange(600) - 300, 0))
    none, *left = (each.score for each in decision(plan).alternatives)
    assert np.isfinite(none)
    assert left
    assert np.isnan(left).all()
    assert decision(plan).choice == "none"
    assert "is not scored on the others" in decision(plan).sentence


def test_an_output_of_two_inputs_is_transformed_as_one_of_one_input_is(record):
    u = np.column_stack([record[0], np.random.default_rng(9).standard_normal(600)])
    y = record[1] + lfilter([0.0, 0.6], [1.0, -0.7], u[:, 1])
    assert decision(plan_of(u, y)).choice == "none"
    drifting = plan_of(u, y + SLOPE * np.arange(600))
    assert drifting.output_trend == pytest.approx(SLOPE, rel=0.05)
    bent = plan_of(u, np.exp(0.15 * y))
    assert bent.box_cox == pytest.approx(0.0, abs=0.2)


def test_a_trend_that_the_input_drives_stays(record):
    u, noise = record[0] + SLOPE * np.arange(600), np.random.default_rng(8).standard_normal(600)
    y = lfilter([0.0, 1.0, 0.5], [1.0, -1.5, 0.8], u) + noise
    assert plan_of(u, y).output_trend == 0.0


def test_a_trend_is_not_carried_to_other_recordings(record):
    u, y = record
    plan = plan_of(u, y + SLOPE * np.arange(600), continued=False)
    assert plan.output_trend == 0.0
    assert "other recordings" in decision(plan).sentence


def test_an_output_whose_spread_grows_with_its_level_is_transformed(record):
    u, y = record
    y = np.exp(0.15 * y)
    assert spread_test([Segment(u, y)]) < 1e-3
    plan = plan_of(u, y)
    assert plan.box_cox == pytest.approx(0.0, abs=0.2)
    scores = {each.name: each.score for each in decision(plan).alternatives}
    assert scores[decision(plan).choice] < 0.7 * scores["none"]


def test_what_the_configuration_says_is_not_decided(record):
    u, y = record
    plan = plan_of(u, np.exp(0.15 * y), box_cox=True, trend=True)
    assert plan.box_cox is None
    assert not plan.has_trend
    assert all("configuration" in each.sentence for each in plan.decisions)


def settings_of(**keys):
    content = {"datasets": {"a": {"file": "a.csv", "input": 1, "sampling_rate": 50, **keys}}}
    return complete(content).datasets["a"]


def test_a_written_transform_takes_the_place_of_its_decision_alone():
    own = settings_of(recipe="auto")
    assert own.automatic.preparation == GivenPreparation()
    assert "transforms" not in yaml_text(own)
    own = settings_of(recipe="auto", transforms={"difference": 0})
    assert own.automatic.preparation == GivenPreparation(differences=0)
    assert "transforms: {difference: 0}" in yaml_text(own)
    own = settings_of(recipe="auto", transforms={"box_cox": "none"})
    assert own.automatic.preparation == GivenPreparation(box_cox=True)


@pytest.mark.parametrize("kind", ["trend", "box_cox"])
def test_decided_transforms_lead_back_to_the_recording(record, kind, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    u, y = record
    y = y + 10.0 + SLOPE * np.arange(600) if kind == "trend" else np.exp(0.15 * y)
    rows = [f"{a!r},{b!r}" for a, b in zip(u.tolist(), y.tolist(), strict=True)]
    Path("a.csv").write_text("u,y\n" + "\n".join(rows) + "\n")
    files = DatasetFiles.of_dataset("a")
    Path(files.folder, "decisions").mkdir(parents=True)
    channels = ChannelSettings((1,), (2,), 50.0)
    read_recording(files, ("a.csv",), channels)
    preparation = settings_of(recipe="auto").preparation
    prepare_samples(files, preparation, False, (), GivenPreparation())
    decided = load(PreparationPlan, files.decision("preparation")).decisions
    assert "transform" in [each.subject for each in decided]
    (replaced,) = (each.alternatives[1].score for each in decided if each.subject == "outliers")
    assert replaced < 10
    data = load_prepared(files.prepared, files.transforms)
    assert data.transforms.changes_output
    assert data.transforms.has_trend == (kind == "trend")
    for part, begin in (("estimation", 0), ("validation", 480)):
        samples = getattr(data, part)
        known = slice(begin, begin + samples.samples)
        (origin,) = getattr(data.transforms, part)
        back = measured_outputs(data.transforms, origin, samples.outputs)[:, 0]
        # Samples that are taken for wrong ones come back as what replaces them.
        assert np.sum(~np.isclose(back, y[known], rtol=1e-9)) <= replaced
        back = measured_inputs(data.transforms, origin, samples.inputs)[:, 0]
        assert back == pytest.approx(u[known])
