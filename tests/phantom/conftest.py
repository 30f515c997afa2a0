"""Two phantoms, rendered once: one small in pixels, one at the default size."""

from pathlib import Path

import pytest

from col3d.phantom import PhantomSettings, render_phantom


@pytest.fixture(scope="session")
def small() -> PhantomSettings:
    return PhantomSettings(size_hw=(54, 68), frames_per_video=2, videos=("cecum_t1_a", "sigmoid_t3_b"))


@pytest.fixture(scope="session")
def small_root(small: PhantomSettings, tmp_path_factory: pytest.TempPathFactory) -> Path:
    root = tmp_path_factory.mktemp("small") / "phantom"
    render_phantom(root, small, workers=1, progress=False)
    return root


@pytest.fixture(scope="session")
def settings() -> PhantomSettings:
    return PhantomSettings(frames_per_video=8, videos=("trans_t2_a",))


@pytest.fixture(scope="session")
def video(settings: PhantomSettings, tmp_path_factory: pytest.TempPathFactory) -> Path:
    root = tmp_path_factory.mktemp("full") / "phantom"
    render_phantom(root, settings, workers=1, progress=False)
    return root / "trans_t2_a"
