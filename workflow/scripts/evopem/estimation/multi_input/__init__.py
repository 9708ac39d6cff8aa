"""Estimation of polynomial models with several inputs and one output."""
