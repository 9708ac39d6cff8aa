"""A run that is disturbed at a random moment."""

from .fault_injection import inject_faults, report

# Of a sequence that replaces a recording, kills all processes of the run that notices, and restores
# the recording.
SEED = 1936


def test_after_any_fault_the_lists_are_true_and_the_results_those_of_an_undisturbed_run(tmp_path):
    """`python -m tests.workflow.fault_injection` does the same for ten minutes."""
    sequences = inject_faults(tmp_path, seconds=0.0, seed=SEED)
    assert not [report(sequence) for sequence in sequences if sequence.wrong]
