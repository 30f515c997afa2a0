"""The measurements for GPUs run on a CPU, write at once, and go on after a stage that fails."""

import json
import os
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
import torch
from parity import needs_parity
from refusals import refused

from benchmarks.gpu.__main__ import main
from benchmarks.gpu.inside import KINDS, REST, kind_of
from benchmarks.gpu.largest import most
from benchmarks.gpu.parity import TABLE, Tolerance
from benchmarks.gpu.results import Record, Results
from benchmarks.gpu.setting import Setting, smallest
from benchmarks.gpu.stages import Stage, run_stages, stages
from benchmarks.gpu.trainings import TABLE as TRAININGS
from col3d.errors import DataError

pytestmark = pytest.mark.end_to_end

CPU = torch.device("cpu")
PROJECT = Path(__file__).parents[2]


def lines_of(folder: Path) -> list[dict[str, Any]]:
    return [json.loads(line) for line in (folder / "results.jsonl").read_text().splitlines()]


def test_every_stage_writes_its_results(tmp_path: Path) -> None:
    """In a process without the type checks of tests, which the compiler would trace."""
    environment = {name: value for name, value in os.environ.items() if name != "COL3D_PARITY"}
    chosen = ["parity:bts", "speed:col3d_mtl", "speed:pix2pix", "inside", "compiled"]
    call = ["benchmarks.gpu", str(tmp_path), "--device", "cpu", "--quick", "--only", *chosen]
    subprocess.run([sys.executable, "-m", *call], check=True, cwd=PROJECT, env=environment)
    lines, page = lines_of(tmp_path), (tmp_path / "gpu.md").read_text()
    ended = {f"{line['stage']}:{line['of']}": line["outcome"] for line in lines if line["table"] == "Stages"}
    assert (
        ended.pop("parity:bts") == "not run: COL3D_PARITY: must name the folder of reference numbers, got ''"
    )
    done = ["speed:col3d_mtl", "inside:col3d_mtl", "speed:pix2pix", "compiled:col3d_mtl"]
    assert ended == dict.fromkeys(done, "done")
    rows = [line for line in lines if line["table"].startswith("Speed")]
    timed = {(row["network"], row["form"]) for row in rows}
    assert timed >= {("col3d_mtl", "published code"), ("col3d_mtl", "col3d"), ("pix2pix", "col3d")}
    assert all(row["step, ms"] > 0 and row["memory of a step, GB"] > 0 for row in rows)
    shares = [line for line in lines if f"{REST}, %" in line]
    assert len(shares) == 2
    for row in shares:
        assert sum(row[f"{kind}, %"] for kind in (*KINDS, REST)) == pytest.approx(100)
    assert {line["table"] for line in lines} >= {"Aims", "facts"}
    assert all(f"{line['table']}:\n\n|" in page for line in lines if line["table"] != "facts")
    assert len(list(tmp_path.iterdir())) <= 8


def test_frames_are_followed_from_the_store_to_the_step(tmp_path: Path) -> None:
    assert main([str(tmp_path), *["--device", "cpu", "--quick", "--only", "loader"]]) == 0
    rates = {line["what"]: line["frames/s"] for line in lines_of(tmp_path) if "frames/s" in line}
    assert len(rates) == 4
    assert all(rate > 0 for rate in rates.values())


def test_a_training_is_repeated_stopped_and_gone_on_with_to_the_bit(tmp_path: Path) -> None:
    assert main([str(tmp_path), *["--device", "cpu", "--quick", "--only", "training"]]) == 0
    rows = [line for line in lines_of(tmp_path) if line["table"] == TRAININGS]
    assert len(rows) == 4
    assert all(row[""] and row["AbsRel"] > 0 for row in rows)


def test_the_largest_batch_needs_a_gpu(tmp_path: Path) -> None:
    assert main([str(tmp_path), *["--device", "cpu", "--quick", "--only", "largest"]]) == 0
    assert {line["largest batch"] for line in lines_of(tmp_path) if "largest batch" in line} == {
        "not measured: needs CUDA"
    }


@pytest.mark.parametrize("limit", [*range(12), 40])
def test_the_largest_number_that_fits(limit: int) -> None:
    tried: list[int] = []

    def fits(number: int) -> bool:
        tried.append(number)
        return number <= limit

    assert most(fits, 4, 10) == (0 if limit < 4 else min(limit, 10))
    assert len(tried) <= 4


@needs_parity
def test_parity_of_one_network(tmp_path: Path) -> None:
    assert main([str(tmp_path), *["--device", "cpu", "--quick", "--only", "parity:monodepth_fpn"]]) == 0
    rows = [line for line in lines_of(tmp_path) if line["table"] == TABLE]
    assert [row[""] for row in rows] == [True, True]


def test_a_stage_that_fails_does_not_end_the_others(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def breaks(setting: Setting, item: str) -> Iterator[Record]:
        yield {"table": "T", "before": item}
        raise RuntimeError("CUDA out of\nmemory")

    def hangs(setting: Setting, item: str) -> Iterator[Record]:
        yield {"table": "T", "before": item}
        time.sleep(60)

    def lacks(setting: Setting, item: str) -> Iterator[Record]:
        raise DataError("FOLDER: must be there")

    def works(setting: Setting, item: str) -> Iterator[Record]:
        yield {"table": "T", "after": item}

    monkeypatch.setattr("benchmarks.gpu.stages.LEAST_SECONDS", 0.1)
    limits = {breaks: 9.0, hangs: 0.2, lacks: 9.0, works: 9.0}
    chosen = [Stage(work.__name__, "x", seconds, work) for work, seconds in limits.items()]
    results = Results(tmp_path, {"torch": "2"})
    assert run_stages(chosen, smallest(CPU), results, time.perf_counter() + 30) == 2
    assert run_stages(chosen[-1:], smallest(CPU), results, time.perf_counter()) == 0
    assert [line["outcome"] for line in lines_of(tmp_path) if line["table"] == "Stages"] == [
        "RuntimeError: CUDA out of memory",
        "StageTimeoutError: it took longer than its limit of 0.2 s",
        "not run: FOLDER: must be there",
        "done",
        "not run: no time is left",
    ]
    assert "| x |  |" in (tmp_path / "gpu.md").read_text()
    assert "CUDA out of\nmemory" in (tmp_path / "errors.txt").read_text()


def test_stages_are_chosen_by_their_names() -> None:
    assert [stage.name for stage in stages()][-1] == "speed:pix2pix"
    assert [stage.name for stage in stages(["speed:bts", "inside"])] == ["inside:col3d_mtl", "speed:bts"]
    with refused(DataError, "--only", "speed:bts", "speed:btz"):
        stages(["speed:btz"])


@pytest.mark.skipif(torch.cuda.is_available(), reason="there is a GPU")
def test_a_gpu_is_needed_unless_another_device_is_named(tmp_path: Path) -> None:
    with refused(DataError, "--device", "cuda"):
        main([str(tmp_path)])


def test_a_tolerance_holds_the_largest_or_the_mean() -> None:
    assert Tolerance(largest=0.1).met(0.1, 9.0)
    assert not Tolerance(largest=0.1).met(0.2, 0.0)
    assert Tolerance(mean=0.1).met(9.0, 0.1)
    assert not Tolerance(mean=0.1).met(0.0, 0.2)


@pytest.mark.parametrize(
    ("kernel", "kind"),
    [
        ("sm90_xmma_fprop_implicit_gemm_bf16f32", "convolutions"),
        ("nvjet_tst_128x256_64x4", "convolutions"),
        ("aten::convolution_backward", "convolutions"),
        ("void cudnn::ops::nchwToNhwcKernel<float>", "copies"),
        ("Memcpy DtoD (Device -> Device)", "copies"),
        ("void cudnn::bn_fw_tr_1C11_kernel_NCHW<float>", REST),
        ("multi_tensor_apply_kernel<convert>", REST),
    ],
)
def test_kinds_of_kernels(kernel: str, kind: str) -> None:
    assert kind_of(kernel) == kind
