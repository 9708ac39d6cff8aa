"""Automatic identification: each stage a function from typed objects to a typed object."""
