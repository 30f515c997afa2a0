"""From predictions to scores: one scorer for networks, checkpoints and files, and what it writes.

Formulas of metrics are in `metrics`, tables over several runs in `reports`.
"""
