"""What a changed key redoes: the jobs whose arguments change, and those that read what they make.

That Snakemake does so is tested in `tests/workflow`.
"""

import pytest

from evopem.config.defaults import complete
from evopem.pipeline.identification import jobs
from evopem.results.layout import DatasetFiles

FILES = DatasetFiles.of_dataset("a")
RECORDED = {"file": "a.csv", "input": "u", "output": "y", "sampling_rate": 50}
SEVERAL = RECORDED | {"input": ["u", "v"], "form": "ss"}
SYNTHETIC = {"synthesis": "armax", "samples": 700, "recipe": "chapter"}
PREPARED = {"prepare", "estimate_spectrum"}
COMPLETED = {"complete_model", "estimate_varying"}
PHASES = {"estimate_candidates", "select_candidate"}
SEARCHES = {"search_polynomials", "search_state_space", "choose"}


def redone(keys, changed):
    """The names of the stages that run again."""
    before, after = (
        complete({"datasets": {"a": each}}).datasets["a"] for each in (keys, keys | changed)
    )
    known = {job.name: job.arguments for job in jobs(before, FILES)}
    made, names = set(), set()
    for job in jobs(after, FILES):
        arguments = job.arguments
        if known.get(job.name) != arguments or made & set(job.read):
            made |= set(job.made)
            names.add(job.stage.name)
    return names


@pytest.mark.parametrize(
    ("keys", "changed", "unchanged"),
    [
        (RECORDED, {"spectrum": {"nfft": 512}}, {"prepare", *SEARCHES, *COMPLETED}),
        (RECORDED, {"purpose": "prediction"}, {*PREPARED, *SEARCHES}),
        (RECORDED, {"search": {"seed": 2}}, PREPARED),
        (RECORDED, {"focus": "prediction"}, {*PREPARED, *SEARCHES, *COMPLETED}),
        (
            RECORDED,
            {"focus": "simulation"},
            {*PREPARED, "search_polynomials", "search_state_space"},
        ),
        (RECORDED, {"orders": {"nx": [1, 4]}}, {*PREPARED, "search_polynomials"}),
        (RECORDED, {"delay": {"nk": 1}}, set()),
        (RECORDED, {"split": {"discard": 10}}, set()),
        (SEVERAL, {"search": {"evaluations": 9}}, {*PREPARED, *SEARCHES}),
        (SYNTHETIC, {"spectrum": {"nfft": 512}}, {"prepare", *PHASES, "complete_model"}),
        (SYNTHETIC, {"search": {"seed": 2}}, PREPARED),
        (SYNTHETIC, {"split": {"discard": 30}}, set()),
        (SYNTHETIC, {"constraints": {"max_pole_radius": 0.9}}, {*PREPARED, *PHASES}),
    ],
    ids=lambda each: str(sorted(each)),
)
def test_a_changed_key_redoes_what_depends_on_it(keys, changed, unchanged):
    settings = complete({"datasets": {"a": keys}}).datasets["a"]
    everything = {job.stage.name for job in jobs(settings, FILES)}
    assert redone(keys, changed) == everything - unchanged - {"read_recording", "synthesize"}


@pytest.mark.parametrize("keys", [RECORDED, SYNTHETIC], ids=str)
def test_values_written_differently_redo_nothing(keys):
    same = {"spectrum": {"time_halfbandwidth": 4}, "search": {"seed": 1.0, "evaluations": 50}}
    other = {"search": {"evaluations": 50.0, "seed": 1}, "spectrum": {"time_halfbandwidth": 4.0}}
    assert redone(keys | same, other) == set()
