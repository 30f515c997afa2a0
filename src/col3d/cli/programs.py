"""Programs that take options, and the function that each calls with its composed configuration."""

from importlib import import_module
from typing import Any

from col3d.cli.program import launch

RUNS = {
    "train": "col3d.training.train:train",
    "evaluate": "col3d.evaluation.evaluate:evaluate",
    "predict": "col3d.inference.predict:predict",
    "fuse": "col3d.inference.fusion.fuse:fuse",
    "export": "col3d.inference.export.export:export",
    "demo": "col3d.inference.demo.serve:serve",
    "download": "col3d.data.download.download:download",
    "prepare": "col3d.data.cache.prepare:prepare",
    "verify": "col3d.data.checks.verify:verify",
    "benchmark": "col3d.cli.benchmark:benchmark",
}
"""`module:function` by program; imported after composition, so that help and errors appear at once."""


def run(name: str, words: list[str]) -> None:
    """Compose a program's options and run it."""
    if name == "verify":
        words = ["fast=true" if word == "--fast" else word for word in words]

    def call(given: dict[str, Any]) -> Any:
        module, _, function = RUNS[name].partition(":")
        return getattr(import_module(module), function)(given)

    launch(name, call, words)
