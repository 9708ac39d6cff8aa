"""Modes of an arm whose payload grows by three models, for docs/make_gallery.py."""

import numpy as np
from matplotlib.figure import Figure

from evopem import Orders, Recording, SearchSettings, estimate, estimate_varying
from evopem.figures.style import styled, svg_text
from evopem.signals.transforms import box_cox, difference, likeliest_box_cox, positive_shift
from evopem.synthesis import flexible_arm

ORDERS = Orders(na=9, nb=9, nk=3)


@styled
def softening_picture() -> str:
    """Constant as recorded, constant of the transformed record, and moving of the same, as SVG."""
    recording, truth = flexible_arm(1, 3000, softening=0.3)
    seconds, u, y = recording.times[[0, -1]], recording.inputs, recording.outputs
    shift = positive_shift(y)
    stationary = box_cox(y, likeliest_box_cox(recording.output, shift), shift)
    transformed = Recording(difference(u, 2)[0], difference(stationary, 2)[0], 100.0)
    settings = SearchSettings(objective="quadratic", evaluations=200)
    paths = []
    for data in (recording, transformed):
        constant = estimate(data, orders=ORDERS, structure="arx", level=True, settings=settings)
        paths.append([(seconds, (mode, mode)) for mode in constant.model.modes()])
    moving = estimate_varying(transformed, orders=ORDERS, basis="legendre", dimension=4)
    paths.append([(mode.values, mode.modes) for mode in moving.moves.modes])
    figure = Figure(figsize=(9.0, 3.2), layout="constrained")
    panels, first = figure.subplots(1, 3, sharey=True), [mode.frequency_hz for mode in truth.modes]
    titles = "Constant, as recorded", "Constant, transformed", "Moving, transformed"
    for axes, title, shown in zip(panels, titles, paths, strict=True):
        axes.plot(seconds, [first, truth.last_hz], "k--", linewidth=0.8)
        for times, modes in shown:
            f, error = np.array([(m.frequency_hz, 1.96 * m.frequency_se_hz) for m in modes]).T
            if np.median(error / f) < 0.1:
                (line,) = axes.plot(times, f)
                axes.fill_between(times, f - error, f + error, color=line.get_color(), alpha=0.3)
        axes.set(title=title, xlabel="Time (s)")
    panels[0].set_ylabel("Natural frequency (Hz)")
    return svg_text(figure)
