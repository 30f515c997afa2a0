"""Options that change nothing in the weights and numbers of a run, for its identity and for reports."""

UNRELATED = {"overwrite", "output_dir", "logger", "objective", "plugins"}
"""Groups and options that change nothing in the weights and numbers of a run."""
UNRELATED_INSIDE = {
    ("data", "workers"),
    ("data", "store"),
    ("trainer", "profiler"),
    ("trainer", "log_every_n_steps"),
    ("callbacks", "panels"),
    ("callbacks", "predictions"),
    ("callbacks", "checkpoint_minutes"),
}
