"""Evaluation: scoring of predictions under protocols, and the files that it writes.

Formulas of metrics are in `metrics`, tables over several runs in `reports`.
"""
