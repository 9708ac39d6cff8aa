"""The stages that search orders, choose among structures and estimate the chosen model."""
