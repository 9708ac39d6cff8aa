"""Compiled kernels of polynomial models: residuals, loss, gradient, Gauss-Newton, stability."""
