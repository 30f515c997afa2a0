"""References that share no code with the package: scenes known in closed form, and published figures."""

import json
import os
import shutil
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch
from tiny_run import SMALL, TINY, composed
from torch import Tensor

from col3d.phantom import PhantomSettings, render_phantom
from col3d.registry import KINDS, plugins
from col3d.training.train import train

pytest.register_assert_rewrite("laws", "small", "parity", "tiny_task", "fake_runs", "cut_runs", "refusals")

View = tuple[np.ndarray, np.ndarray]
"""Distance along each unit ray and normal (not yet turned to the camera), of rays (n, 3)."""


def plane(rays: np.ndarray) -> View:
    normal, point = np.array([0.36, -0.48, -0.8]), np.array([0.0, 0.0, 60.0])
    return normal @ point / (rays @ normal), np.broadcast_to(normal, rays.shape)


def frontal(rays: np.ndarray) -> View:
    return 50.0 / rays[:, 2], np.broadcast_to(np.array([0.0, 0.0, -1.0]), rays.shape)


def sphere(rays: np.ndarray) -> View:
    centre, radius = np.array([3.0, -4.0, 5.0]), 30.0
    along = rays @ centre
    distance = along + np.sqrt(along**2 - centre @ centre + radius**2)
    return distance, (centre - distance[:, None] * rays) / radius


def tube(rays: np.ndarray) -> View:
    """A bent-away pipe: the camera is inside and sees its far end out of the picture."""
    axis = np.array([0.7, 0.3, 0.65])
    axis, inside, radius = axis / np.linalg.norm(axis), np.array([2.0, 5.0, 1.0]), 20.0
    across = rays - np.outer(rays @ axis, axis)
    start = -(inside - inside @ axis * axis)
    a, b, c = (across**2).sum(axis=1), across @ start, start @ start - radius**2
    distance = (-b + np.sqrt(b**2 - a * c)) / np.maximum(a, 1e-12)
    return distance, -(start + distance[:, None] * across) / radius


SCENES = {"plane": plane, "frontal": frontal, "sphere": sphere, "tube": tube}
Look = Callable[[str, Tensor], tuple[Tensor, Tensor, Tensor]]


@pytest.fixture(autouse=True)
def environment() -> Iterator[None]:
    """What a test sets, such as Lightning's seed, is not handed to the programs that later tests start."""
    before = dict(os.environ)
    yield
    for name in {*os.environ} - {*before}:
        del os.environ[name]
    os.environ.update(before)


@contextmanager
def _parts_of_before() -> Iterator[None]:
    """What is registered inside, by a test or by a plugin it loads, is unknown afterwards."""
    for registry in KINDS.values():
        registry.load()
    parts, plugged = {kind: dict(registry.parts) for kind, registry in KINDS.items()}, set(plugins.loaded)
    yield
    for kind, registry in KINDS.items():
        registry.parts.clear()
        registry.parts.update(parts[kind])
    for name in {*plugins.loaded} - plugged:
        del plugins.loaded[name]
        for module in [m for m in sys.modules if m == name or m.startswith(f"{name}.")]:
            del sys.modules[module]


@pytest.fixture(autouse=True, scope="module")
def _parts_of_this_file_alone() -> Iterator[None]:
    with _parts_of_before():
        yield


@pytest.fixture(autouse=True)
def _parts_of_this_test_alone() -> Iterator[None]:
    with _parts_of_before():
        yield


@pytest.fixture(scope="session")
def look() -> Look:
    """(scene, rays (3, h, w)) -> depth (1, 1, h, w), normals (1, 3, h, w) in float64, mask of 1..100 mm."""

    def see(scene: str, rays: Tensor) -> tuple[Tensor, Tensor, Tensor]:
        size_hw = rays.shape[-2:]
        flat = rays.double().flatten(1).T.numpy()
        flat = flat / np.linalg.norm(flat, axis=1, keepdims=True)
        distance, normals = SCENES[scene](flat)
        depth = distance * flat[:, 2]
        mask = (depth > 1) & (depth < 100) & (distance > 0) & (flat[:, 2] > 0.2)
        assert (np.sum(normals * flat, axis=1)[mask] < 0).all()
        maps = (depth[:, None], normals, mask[:, None])
        found = [torch.from_numpy(m.T.reshape(1, -1, *size_hw).copy()) for m in maps]
        return found[0], found[1], found[2]

    return see


@pytest.fixture(scope="session")
def published() -> tuple[dict[str, Any], dict[str, Tensor]]:
    """Figures, and the maps they are of as batches of one."""
    if "COL3D_PARITY" not in os.environ:
        pytest.skip("COL3D_PARITY names no folder of reference numbers")
    folder = Path(os.environ["COL3D_PARITY"])
    with np.load(folder / "numbers_inputs.npz") as stored:
        maps = {name: torch.from_numpy(stored[name]) for name in stored.files}
    batched = {name: values.reshape(1, -1, *values.shape[-2:]) for name, values in maps.items()}
    return json.loads((folder / "numbers.json").read_text()), batched


@pytest.fixture(scope="module")
def browser() -> Iterator[Any]:
    """Chromium, for pages."""
    programs = {name: shutil.which(name) for name in ("chromium", "chromedriver")}
    missing = [name for name, path in programs.items() if path is None]
    if missing:
        pytest.skip(f"{' and '.join(missing)} not on PATH: pages are not opened")
    from selenium import webdriver

    options = webdriver.ChromeOptions()
    options.binary_location = str(programs["chromium"])
    for argument in ("--headless=new", "--no-sandbox", "--disable-gpu", "--disable-dev-shm-usage"):
        options.add_argument(argument)
    options.set_capability("goog:loggingPrefs", {"browser": "ALL"})
    driver = webdriver.Chrome(options, webdriver.ChromeService(str(programs["chromedriver"])))
    yield driver
    driver.quit()


@pytest.fixture(scope="session")
def phantom_root(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("phantom") / "frames"


@pytest.fixture(scope="session")
def rendered(phantom_root: Path) -> Path:
    """A video of three frames."""
    settings = PhantomSettings(size_hw=(64, 80), frames_per_video=3, videos=("desc_t4_a",))
    render_phantom(phantom_root, settings, workers=1, progress=False)
    return phantom_root / "desc_t4_a"


@pytest.fixture
def tiny(phantom_root: Path, tmp_path: Path) -> Callable[..., dict[str, Any]]:
    """Composes the smallest run, into the test's own folder."""

    def compose_tiny(*overrides: str) -> dict[str, Any]:
        place = (f"data.root={phantom_root}", f"output_dir={tmp_path / 'run'}")
        encoder = () if any(override.startswith("model=") for override in overrides) else (SMALL,)
        return composed("train", *TINY, *encoder, *place, *overrides)

    return compose_tiny


@pytest.fixture(scope="session")
def tiny_checkpoint(phantom_root: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Weights of a training of seconds, with depth and normals."""
    folder = tmp_path_factory.mktemp("trained") / "run"
    place = (f"data.root={phantom_root}", f"output_dir={folder}", "callbacks.panels=0")
    train(composed("train", *TINY, SMALL, *place))
    return folder / "checkpoints" / "best.ckpt"


@pytest.fixture(autouse=True)
def _offline(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("WANDB_SILENT", "true")
    monkeypatch.setenv("WANDB_ERROR_REPORTING", "false")
