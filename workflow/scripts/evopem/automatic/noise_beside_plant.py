"""Noise models that are fitted to the errors of simulation of a plant, which stays as it is."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from evopem.automatic.candidates import Candidate, Scorer
from evopem.automatic.fit import FitSettings, fit, log_loss
from evopem.automatic.held_out.simulation import simulated
from evopem.errors import NoModelError
from evopem.models.polynomial import PolynomialModel
from evopem.models.structures import Orders
from evopem.signals.recording import Segment, total_samples

NOISE_ORDERS = (1, 2, 3, 4, 6, 8, 10, 12)


def with_noise_models(scorer: Scorer, candidate: Candidate) -> Iterator[tuple[int, Candidate]]:
    """A plant of one input with noise models of ascending order, fitted to its simulation errors.

    Simulations stay as they are, predictions gain.
    """
    plant = candidate.polynomials
    assert plant is not None
    errors = [
        Segment(np.empty((each.samples, 0)), each.outputs - simulated(plant, each), each.recording)
        for each in scorer.stretches
    ]
    count, objective = total_samples(errors), scorer.settings.objective
    for n in NOISE_ORDERS:
        orders = Orders(na=n, nc=n)
        if candidate.parameters + orders.parameters > scorer.most_parameters:
            return
        try:
            noise = fit(errors, orders, FitSettings(objective, level=False))
        except NoModelError:
            continue
        assert isinstance(noise.model, PolynomialModel)
        parameters = candidate.orders.single.nb + candidate.orders.single.nf + orders.parameters + 1
        loss = log_loss(noise.residuals_from(), objective)
        model = replace(
            plant,
            C=noise.model.C,
            D=noise.model.A,
            noise_variance=noise.model.noise_variance,
            structure="bj",
        )
        if scorer.limits.allow("bj", model.orders):
            yield (
                n,
                replace(
                    candidate,
                    structure="bj",
                    parameters=parameters,
                    bic=float(loss + parameters * np.log(count) / count),
                    polynomials=model,
                ),
            )
