"""Literal twins of published programs, for timing and for agreement; nothing of the package uses them."""
