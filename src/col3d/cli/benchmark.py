"""`col3d benchmark`: run the jobs of experiments and report them."""

from pathlib import Path
from typing import Any

from col3d.cli.program import composed
from col3d.cli.resolvers import slug
from col3d.cli.sweeps import given_overrides, sweep_of
from col3d.registry.refusals import check_options
from col3d.training.benchmark import make_job, run_benchmark
from col3d.training.options import BenchmarkFile


def benchmark(given: dict[str, Any]) -> None:
    """Make the jobs of the experiments, run them and write the report."""
    options = check_options(BenchmarkFile, {"benchmark": given["benchmark"]}).benchmark
    output = Path(options.output).absolute()
    epochs = options.epochs.get(given["preset"])
    fewer = [] if epochs is None else [f"trainer.max_epochs={epochs}"]
    common = ["callbacks.predictions=true", *fewer, *given_overrides(besides="benchmark")]
    jobs = []
    for row in [row for name in options.experiments for row in sweep_of(name, options.seeds)]:
        folder = output / "runs" / slug(",".join(row))
        overrides = [*common, *row]
        jobs.append(make_job(overrides, composed("train", [*overrides, f"output_dir={folder}"])))
    run_benchmark(jobs, output, options.parallel)
