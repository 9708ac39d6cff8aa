"""Held-out samples, and simulations of them that models are scored by."""
