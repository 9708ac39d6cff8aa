"""Prepared inputs as they were measured."""

from dataclasses import replace

from evopem.signals.prepared_data import measured_outputs


def measured_inputs(transforms, origin, inputs):
    """In the measured unit, as of outputs without a Box-Cox transform."""
    as_output = replace(transforms, box_cox=None, output_trends=transforms.input_trends)
    means, initial = origin.input_means, origin.input_initial
    origin = replace(origin, output_means=means, output_initial=initial)
    return measured_outputs(as_output, origin, inputs)
