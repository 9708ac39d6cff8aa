"""Results of the chapter on its own recording, which the simulated flexible arm stands in for."""

from __future__ import annotations

from evopem.config.channels import SyntheticSource
from evopem.config.settings import DatasetSettings
from evopem.models.structures import armax_orders
from evopem.report.numbers import number
from evopem.results.dataset import DatasetResults
from evopem.synthesis.armax import true_mode

SAMPLING_RATE = 100.0
# Table 2: natural frequency in Hz, damping ratio.
MODES = tuple(
    true_mode(frequency, damping, SAMPLING_RATE)
    for frequency, damping in ((5.36, 0.0091), (16.65, 0.1750), (37.00, 0.0107))
)
# Sections 5.1 to 5.4.
ORDERS = armax_orders(7, 6, 7, 3)
SPECTRAL_PEAKS = "near 2, 5 and 36, a broad one near 17"
JOINT_ORDER, ORDER_OF_C, COEFFICIENTS_OF_B = 7, 7, 6


def stands_in_for_the_chapter(settings: DatasetSettings) -> bool:
    """Whether a data set is an ARMAX model of the simulated arm, as the chapter's recording."""
    source = settings.source
    of_arm = isinstance(source, SyntheticSource) and source.synthesis == "flexible_arm"
    by_chapter = settings.automatic is None and settings.order_grid.structure == "armax"
    return of_arm and by_chapter


def compare_with_chapter(results: DatasetResults) -> list[tuple[str, str, str]]:
    """Quantity, value of these results, value of the chapter."""
    selected = {phase: selection.orders for phase, selection in results.phases.items()}
    peaks = [number(peak.frequency_hz, 3) for peak in results.spectrum_summaries[0].peaks]
    return [
        ("Spectral peaks (Hz)", ", ".join(peaks) or "none", SPECTRAL_PEAKS),
        ("Delay nk", str(selected["delay"].single.nk), str(ORDERS.single.nk)),
        ("Joint order", str(selected["joint"].na), str(JOINT_ORDER)),
        ("Order of C, nc", str(selected["nc"].nc), str(ORDER_OF_C)),
        ("Coefficients of B, nb", str(selected["nb"].single.nb), str(COEFFICIENTS_OF_B)),
        ("Model", str(results.model.orders), str(ORDERS)),
    ]
