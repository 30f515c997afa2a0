"""Run folders made up for tests of reports: written as runs write them, with numbers drawn at random."""

import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import yaml

from col3d.io.json_files import write_json
from col3d.registry.metric_specs import PAPER_DEPTH, PAPER_NORMALS
from col3d.reports.paper_tables import methods
from col3d.reports.per_frame import write_per_frame
from col3d.reports.summary import summarise

DEPTH_METRICS = tuple(spec.name for spec in PAPER_DEPTH)
NORMAL_METRICS = tuple(spec.name for spec in PAPER_NORMALS)
METRICS = (*DEPTH_METRICS, *NORMAL_METRICS)
VIDEOS = {
    "cecum_t2_a": "cecum",
    "desc_t4_a": "descending",
    "sigmoid_t3_b": "sigmoid",
    "trans_t3_b": "transverse",
}
SILOG = {"terms": {"depth": {"term": "silog"}}, "lambdas": [1.0]}
NORMALS = {"depth": {"term": "silog"}, "normals": {"term": "normal_l1"}}
CONSISTENT = {**NORMALS, "consistency": {"term": "cross_task_rmse", "geometry": "rays"}}
LOSSES: dict[str, dict[str, Any]] = {
    "bts": SILOG,
    "bts_cbam": SILOG,
    "newcrfs": SILOG,
    "bts_cbam_mtl": {"terms": NORMALS, "lambdas": [0.5, 0.5]},
    "col3d_mtl": {"terms": CONSISTENT, "lambdas": [0.5, 0.3, 0.2]},
    "pix2pix": {"terms": {"depth": {"term": "depth_l1"}}, "lambdas": [100.0]},
    "monodepth_fpn": {
        "terms": {
            "depth": {"term": "rmse_log"},
            "gradients": {"term": "gradient_l1", "from_epoch": 4},
            "directions": {"term": "gradient_direction", "from_epoch": 8},
        },
        "lambdas": [1.0, 10.0, 1.0],
    },
}


COLOURS = dict(
    zip(LOSSES, ("#0072B2", "#56B4E9", "#009E73", "#000000", "#D55E00", "#E69F00", "#CC79A7"), strict=True)
)
"""That registrations give, by model."""


def with_rmse(model: str) -> dict[str, Any]:
    """Terms of a network's loss with normals by their root mean squared error."""
    return {**LOSSES[model]["terms"], "normals": {"term": "normal_rmse"}}


def options_of(model: str = "bts", seed: int = 0, **changes: Any) -> dict[str, Any]:
    """config.yaml of a run; `changes` are dotted with two underscores."""
    predicts = model in ("bts_cbam_mtl", "col3d_mtl")
    options: dict[str, Any] = {
        "seed": seed,
        "output_dir": f"/runs/{model}_{seed}",
        "preset": "laptop",
        "model": {
            "name": model,
            "normals": "unc" if predicts else "none",
            "normal_frame": "camera",
            "width": 128,
        },
        "loss": {**LOSSES[model]},
        "data": {
            "name": "phantom",
            "root": "/data/phantom",
            "split": {"name": "paper", "train": ["cecum_t1_a", "trans_t1_a:0-7"], "test": list(VIDEOS)},
            "size": [128, 160],
        },
        "phantom": {"frames_per_video": 24},
        "trainer": {"max_epochs": 10},
        "protocol": {"standard": {"mirror": None}},
    }
    for path, value in changes.items():
        group, _, name = path.partition("__")
        options[group] = {**options[group], name: value} if name else value
    return options


def rows_of(
    facts: dict[str, Any], videos: Sequence[str], frames: int, normals: bool, worse: float
) -> list[Any]:
    """Rows of per_frame.csv; a method's frames are those of every other, times `worse`."""
    random = np.random.default_rng(int(facts["seed"]))
    rows = []
    for video in videos:
        level = 0.1 + 0.1 * sorted(VIDEOS).index(video)
        for frame in range(frames):
            where = {**facts, "video": video, "segment": VIDEOS[video], "texture": "1", "frame": frame}
            values = {name: worse * level * (1 + 0.2 * random.random()) for name in (*METRICS, "delta_1_1")}
            kept = {k: v for k, v in values.items() if normals or k not in NORMAL_METRICS}
            rows.append({**where, **kept, "pixels": 1000 + frame})
    return rows


def write_run(
    folder: Path,
    model: str = "bts",
    seed: int = 0,
    worse: float = 1.0,
    videos: Sequence[str] = tuple(VIDEOS),
    frames: int = 6,
    first: int = 0,
    facts: dict[str, Any] | None = None,
    evaluation: str | None = None,
    **changes: Any,
) -> Path:
    """Write a finished run, or an evaluation in a folder inside one.

    Args:
        folder: of the run.
        worse: what its numbers are times those of any other.
        videos: that were scored.
        frames: of each video.
        first: number of the first frame.
        facts: entries of summary.json that differ from the usual.
        evaluation: name of the folder inside.
        changes: options, see `options_of`.
    """
    folder.mkdir(parents=True, exist_ok=True)
    options = options_of(model, seed, **changes)
    if evaluation is None:
        (folder / "config.yaml").write_text(yaml.safe_dump(options, sort_keys=False))
    where = folder if evaluation is None else folder / evaluation
    where.mkdir(exist_ok=True)
    given = {"model": model, "seed": seed, "data": "phantom", "split": "test", "protocol": "standard"}
    given |= {key: value for key, value in (facts or {}).items() if key in given}
    rows = rows_of(given, videos, frames, options["model"]["normals"] == "unc", worse)
    rows = [{**row, "frame": row["frame"] + first} for row in rows]
    write_per_frame(where / "per_frame.csv", rows)
    more = {
        "label": methods()[model],
        "colour": COLOURS[model],
        "split_name": "paper",
        "frames_by_split": {"train": 32, "val": 8, "test": len(rows)},
        "checkpoint": str(folder / "checkpoints" / "best.ckpt"),
        "best": {"val/abs_rel": 0.2, "epoch": 9},
        "versions": {"col3d": "0.1.0", "torch": "2.14.1"},
        "parameters": 12_000_000,
        "cost": {
            "parameters": 12_000_000,
            "gflop": 9.5,
            "frames_per_second": 20.0 + seed,
            "size": options["data"]["size"],
        },
        "command": f"python train.py model={model} seed={seed}",
        "commit": "abc1234",
    }
    write_json(where / "summary.json", {**summarise(rows, {**given, **more}), **(facts or {})})
    return where


def change_summary(folder: Path, **entries: Any) -> None:
    """Rewrite entries of summary.json; None removes one."""
    path = folder / "summary.json"
    summary = json.loads(path.read_text()) | entries
    path.write_text(json.dumps({key: value for key, value in summary.items() if value is not None}))


def write_paper(root: Path, seeds: Sequence[int] = (0, 1)) -> Path:
    """Runs for every row of the ablation and the benchmark, and two of the study of weights."""
    names = ("bts", "bts_cbam", "bts_cbam_mtl", "col3d_mtl", "pix2pix", "monodepth_fpn", "newcrfs")
    for seed in seeds:
        for number, model in enumerate(names):
            write_run(root / f"{model}_{seed}", model, seed, worse=1.0 - 0.03 * number)
            if model in ("bts_cbam_mtl", "col3d_mtl"):
                write_run(root / f"{model}_l2_{seed}", model, seed, worse=1.05, loss__terms=with_rmse(model))
        write_run(root / f"weights_{seed}", "col3d_mtl", seed, worse=0.97, loss__lambdas=[0.4, 0.3, 0.3])
    return root
