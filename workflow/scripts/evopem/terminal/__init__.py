"""The command ``evopem``: its arguments, and what it prints."""
