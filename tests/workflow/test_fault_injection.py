"""Runs that are disturbed at random moments, for a few seconds."""

from .fault_injection import inject_faults, report


def test_after_any_fault_the_lists_are_true_and_the_results_those_of_an_undisturbed_run(tmp_path):
    """`python -m tests.workflow.fault_injection` does the same for ten minutes."""
    sequences = inject_faults(tmp_path, seconds=5.0, seed=1)
    assert not [report(sequence) for sequence in sequences if sequence.wrong]
