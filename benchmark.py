"""Run the paper's experiments and report them: python benchmark.py preset=laptop."""

from pathlib import Path
from typing import Any

from launch import composed, given_overrides, launch, slug, sweep_of


def run(given: dict[str, Any]) -> None:
    """Make the jobs, run them and write the report."""
    from col3d.app.benchmark import make_job, run_benchmark
    from col3d.app.config import BenchmarkFile
    from col3d.refusals import check_options

    options = check_options(BenchmarkFile, {"benchmark": given["benchmark"]}).benchmark
    output = Path(options.output).absolute()
    epochs = options.epochs.get(given["preset"])
    fewer = [] if epochs is None else [f"trainer.max_epochs={epochs}"]
    common = ["callbacks.predictions=true", *fewer, *given_overrides(besides="benchmark")]
    jobs = []
    for row in [row for name in options.experiments for row in sweep_of(name, options.seeds)]:
        folder = output / "runs" / slug(",".join(row))
        asked = [*common, *row]
        jobs.append(make_job(asked, composed("train", [*asked, f"output_dir={folder}"])))
    run_benchmark(jobs, Path(__file__).parent / "train.py", output, options.parallel)


if __name__ == "__main__":
    launch("benchmark", run)
