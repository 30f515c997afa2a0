"""Options that do not change a run's weights and numbers, for its identity and for reports."""

UNRELATED = {"overwrite", "output_dir", "logger", "objective", "plugins"}
"""Top-level groups and options without effect on the weights and numbers of a run."""
UNRELATED_INSIDE = {
    ("data", "workers"),
    ("data", "store"),
    ("trainer", "profiler"),
    ("trainer", "log_every_n_steps"),
    ("callbacks", "panels"),
    ("callbacks", "predictions"),
    ("callbacks", "checkpoint_minutes"),
}
"""Options inside of groups without effect on the weights and numbers of a run."""
