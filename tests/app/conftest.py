from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from tiny_run import SMALL, TINY, composed

from col3d.phantom import PhantomSettings, render_phantom
from col3d.training.train import train


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
