"""Comparison of the product's memetic search with other algorithms on the Fletcher-Powell function.

A benchmark beside the product: it imports `evopem`, and `evopem` never imports it.
"""
