"""The automatic recipe in one process: a record with clipped samples, from file to report."""

import json
from contextlib import nullcontext
from functools import partial
from pathlib import Path

import numpy as np
import pytest
from identified import undrawn_page
from scipy.signal import lfilter

from evopem.automatic.decision import DecisionRecord
from evopem.automatic.revisions import Revised
from evopem.config.constraints import Constraints
from evopem.config.defaults import complete
from evopem.config.settings import AutomaticSettings
from evopem.errors import InputError, LostModelError, NoModelError
from evopem.estimation.model_record import ModelRecord
from evopem.files.json_form import load
from evopem.models.polynomial import PolynomialModel
from evopem.models.response_tables import furthest_rival
from evopem.pipeline import complete_model
from evopem.pipeline.identification import identify_dataset, jobs
from evopem.pipeline.structure_search import errors_name_dataset
from evopem.results.layout import DatasetFiles

STAGES = (
    *("read_recording", "prepare", "estimate_spectrum", "search_polynomials", "choose"),
    *("complete_model", "estimate_varying", "validate", "report"),
)
POLES = [1.0, -1.5, 0.7]


def settings_of(file):
    keys = {
        "file": file,
        "sampling_rate": 10,
        "spectrum": {"nfft": 512},
        "structure": "arx",
        "orders": {"plant": [1, 4]},
        "search": {"evaluations": 500},
    }
    return complete({"datasets": {"pump": keys}}).datasets["pump"]


def test_a_record_that_is_too_short_names_its_data_set_and_a_fault_is_none():
    named = partial(errors_name_dataset, DatasetFiles("results/pump"))
    with pytest.raises(InputError, match="pump: too short; give a longer recording"), named():
        raise NoModelError("too short")
    for fault in (ValueError("shapes differ"), np.linalg.LinAlgError("singular")):
        with pytest.raises(type(fault), match=f"^{fault}$") as raised, named():
            raise fault
        assert raised.value is fault


@pytest.fixture(scope="module")
def clipped(tmp_path_factory):
    folder = tmp_path_factory.mktemp("clipped")
    u, e = np.random.default_rng(2).standard_normal((2, 700))
    y = lfilter([0.0, 1.0], POLES, np.repeat(u[:100], 7)) + lfilter([1.0], POLES, 0.3 * e)
    y = np.minimum(y, np.quantile(y, 0.97))
    file = folder / "pump.csv"
    rows = np.column_stack([np.repeat(u[:100], 7), y])
    np.savetxt(file, rows, delimiter=",", header="u,y", comments="", fmt="%.10g")
    files = DatasetFiles(str(folder / "results" / "pump"))
    identify_dataset(files, settings_of(str(file)), with_report=False)
    return files


def test_the_stages_are_listed_in_their_order(clipped):
    assert tuple(job.name for job in jobs(settings_of("pump.csv"), clipped)) == STAGES


def test_clipped_samples_are_breaks_and_the_model_comes_from_all_stretches(clipped):
    record = load(DecisionRecord, clipped.decisions)
    assert "stretches with breaks between them" in record.remarks[0]
    (likely,) = record.likely_delays
    assert 1 in likely
    assert (len(likely) > 1) == any(
        "Delay in samples, with 95 % probability" in remark for remark in record.remarks
    )
    model = load(ModelRecord, clipped.model)
    (delay,) = json.loads(Path(clipped.verdict).read_text())["delays"]
    assert delay == {"input": "u", "samples": model.delays[0], "likely": list(likely)}
    stretches = model.transforms.estimation
    assert len(stretches) > 5
    assert model.transforms.estimation_samples == sum(each.samples for each in stretches)
    assert model.model.poles()[:2] == pytest.approx(np.roots(POLES), abs=0.08)


BEYOND = InputError("search.max_root_radius", "the model has a root beyond it", "raise it")


@pytest.mark.parametrize(
    "error",
    [
        LostModelError("search", "its errors are lost in rounding", "lower the orders"),
        NoModelError("no descent ended at a stable model"),
        BEYOND,
        InputError("focus", "it has no meaning", "change it"),
    ],
)
def test_what_spoils_a_model_for_another_purpose_does_not_refuse_the_recording(
    clipped, monkeypatch, error
):
    """Without a model of its own the chosen one serves."""
    fits, known = [], load(ModelRecord, clipped.model)

    def record(choice, scored, search, settings, fit, *_):
        fits.append(fit)
        if settings.evaluations == 0 and len(fits) == 2:
            raise error
        return known, load(Revised, files.decision("revisions")).search

    files = clipped
    monkeypatch.setattr(complete_model, "_record_of", record)
    job = next(each for each in jobs(settings_of("pump.csv"), clipped) if "model" in each.name)
    refused = pytest.raises(InputError, match=r"datasets\.pump\.focus: it has no meaning")
    with refused if getattr(error, "source", "") == "focus" else nullcontext():
        job.run()
    assert len(fits) == 2  # prediction and modes have one candidate


@pytest.mark.parametrize("error", [None, BEYOND, NoModelError("no descent ended at one")])
def test_a_model_for_another_purpose_gives_up_constraints_before_the_chosen_one_serves(
    monkeypatch, error
):
    def record(choice, scored, search, settings, fit):
        if fit.constraints is not None:
            raise InputError("constraints", "it cannot be met", "change it", "max_pole_radius")
        if error is not None:
            raise error
        return "free", None

    monkeypatch.setattr(complete_model, "_record_of", record)
    given = None, None, None, AutomaticSettings(), Constraints(max_pole_radius=0.5)
    model = complete_model._for_other_purpose("chosen", *given)
    assert model == ("free" if error is None else "chosen")


def test_the_report_shows_the_decisions(clipped):
    page = undrawn_page(clipped)
    assert 'data-name="Decisions"' in page
    assert "become breaks" in page
    assert "stretches with breaks between them" in page


def test_the_rival_is_the_model_whose_response_differs_most():
    def resonance(damping):
        pole = 0.5 + 0.5j * damping
        return PolynomialModel([1.0, -2.0 * pole.real, abs(pole) ** 2], [1.0], nk=1)

    models = [resonance(damping) for damping in (1.6, 1.59, 1.3)]
    rival = furthest_rival(["chosen", "near", "far"], models, 1000)
    assert rival.name == "far"
    gains = np.abs([model.frequency_response([rival.frequency_hz])[0, 0, 0] for model in models])
    assert gains[0] == max(gains)  # at the resonance of the chosen one
    assert rival.factor > 1.5
    gain = [PolynomialModel([1.0], [factor], nk=1) for factor in (2.0, 6.0)]
    assert furthest_rival(["chosen", "scaled"], gain, 1000).factor == pytest.approx(3.0)
    assert furthest_rival(["chosen"], models[:1], 1000) is None
    assert furthest_rival(["chosen", "other"], [PolynomialModel([1.0, -0.5], ())] * 2, 1000) is None
