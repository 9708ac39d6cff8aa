"""Sentences of the report, computed from the results.

Each function returns paragraphs.
"""
