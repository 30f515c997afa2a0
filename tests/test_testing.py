"""The laws for other people's tests: our parts obey them, and each broken part is told which it breaks."""

import functools

import pytest
import torch
from refusals import refused
from torch import Tensor, nn

from col3d.data.datasets.c3vd import C3VD
from col3d.losses import WeightedLoss
from col3d.metrics.functional import depth_metrics, normal_metrics
from col3d.models import create
from col3d.phantom import PhantomSettings, phantom_camera, render_phantom
from col3d.registry import LOSSES, available
from col3d.testing import check_dataset, check_loss, check_metric, check_network, scene


class Net(nn.Module):
    """One convolution."""

    def __init__(self) -> None:
        super().__init__()
        self.layers = nn.Conv2d(3, 1, 3, padding=1)

    def forward(self, image: Tensor, rays: Tensor | None = None) -> dict[str, Tensor]:
        return {"depth": 100 * self.layers(image).sigmoid()}


class Negative(Net):
    def forward(self, image: Tensor, rays: Tensor | None = None) -> dict[str, Tensor]:
        return {"depth": -super().forward(image)["depth"]}


class Small(Net):
    def forward(self, image: Tensor, rays: Tensor | None = None) -> dict[str, Tensor]:
        return {"depth": super().forward(image)["depth"][..., ::2, ::2]}


class OfTheBatch(Net):
    def forward(self, image: Tensor, rays: Tensor | None = None) -> dict[str, Tensor]:
        return super().forward(image - image.mean() * len(image))


class Idle(Net):
    def __init__(self) -> None:
        super().__init__()
        self.idle = nn.Linear(1, 1)


class Random(Net):
    def forward(self, image: Tensor, rays: Tensor | None = None) -> dict[str, Tensor]:
        return super().forward(image + torch.rand_like(image))


class Hidden(Net):
    """Has a number that is in no state_dict."""

    def __init__(self) -> None:
        super().__init__()
        self.number = torch.rand(())

    def forward(self, image: Tensor, rays: Tensor | None = None) -> dict[str, Tensor]:
        return super().forward(image * self.number)


def test_networks_of_ours_obey_them() -> None:
    check_network(Net)
    check_network(lambda: create("bts", encoder="lcnet_035", width=64))
    check_network(lambda: create("col3d_mtl", encoder="lcnet_035", width=64, normal_frame="ray"))


@pytest.mark.parametrize(
    ("broken", "named"),
    [
        (Negative, ("depth ", "above 0 mm")),
        (Small, ("depth ", "(2, 1, 64, 96)", "got (2, 1, 32, 48)")),
        (OfTheBatch, ("alone and in a batch",)),
        (Idle, ("gradient", "idle.weight")),
        (Random, ("same image", "same prediction")),
        (Hidden, ("state_dict",)),
    ],
)
def test_a_broken_network_is_told_the_law(broken: type[nn.Module], named: tuple[str, ...]) -> None:
    with refused(AssertionError, None, *named):
        check_network(broken)


@pytest.mark.parametrize("name", available("loss"))
def test_losses_of_ours_obey_them(name: str) -> None:
    loss = WeightedLoss([1.0], {"it": name})
    check_loss(
        lambda prediction, batch: loss(prediction, batch)["it"], LOSSES[name].facts["needs"], atol=1e-2
    )


def unmasked(prediction, batch) -> Tensor:
    return (prediction["depth"] - batch["depth"]).abs().mean()


def biased(prediction, batch) -> Tensor:
    return torch.where(batch["mask"], prediction["depth"] - batch["depth"], 0.0).abs().mean() + 1


def of_nothing(prediction, batch) -> Tensor:
    gap = torch.where(batch["mask"], prediction["depth"] - batch["depth"], 0.0).abs()
    return gap.sum() / batch["mask"].sum()


def each(prediction, batch) -> Tensor:
    return torch.where(batch["mask"], prediction["depth"] - batch["depth"], 0.0).abs().mean(dim=(1, 2, 3))


@pytest.mark.parametrize(
    ("broken", "named"),
    [
        (unmasked, ("zero at the truth",)),
        (biased, ("zero at the truth", "got 1")),
        (of_nothing, ("no pixels", "finite")),
        (each, ("scalar", "got (2,)")),
    ],
)
def test_a_broken_loss_is_told_the_law(broken, named: tuple[str, ...]) -> None:
    with refused(AssertionError, None, *named):
        check_loss(broken)


def test_metrics_of_ours_obey_them() -> None:
    for name, best in {"abs_rel": 0.0, "rmse": 0.0, "silog": 0.0, "delta1": 1.0}.items():
        check_metric(lambda p, t, m, name=name: depth_metrics(p, t, m)[name], at_truth=best)
    for name, best in {"angle_mean": 0.0, "within_30": 1.0}.items():
        check_metric(lambda p, t, m, name=name: normal_metrics(p, t, m)[name], "normals", best)


@pytest.mark.parametrize(
    ("broken", "named"),
    [
        (lambda p, t, m: (p - t).abs().mean(), "one value a frame"),
        (lambda p, t, m: (p - t).abs().mean(dim=(1, 2, 3)), "mask"),
        (lambda p, t, m: (p - t).mul(m).mean(dim=(1, 2, 3)) / len(p), "alone and in a batch"),
        (lambda p, t, m: (p - t).mul(m).mean(dim=(1, 2, 3)) + 1, "at the truth"),
    ],
)
def test_a_broken_metric_is_told_the_law(broken, named: str) -> None:
    with refused(AssertionError, None, named):
        check_metric(broken, at_truth=0.0)


@pytest.fixture(scope="module")
def phantom(tmp_path_factory: pytest.TempPathFactory) -> C3VD:
    root = tmp_path_factory.mktemp("laws")
    settings = PhantomSettings(size_hw=(64, 80), frames_per_video=2, videos=("cecum_t1_a",))
    render_phantom(root, settings, workers=1, progress=False)
    return C3VD(root, ["cecum_t1_a"], camera=phantom_camera(settings))


def test_a_data_set_of_ours_obeys_them(phantom: C3VD) -> None:
    check_dataset(phantom)


@pytest.mark.parametrize(
    ("key", "change", "named"),
    [
        ("image", lambda x: x * 255, "image is in [0, 1]"),
        ("depth", lambda x: x + 1, "depth that does not count"),
        ("depth", lambda x: x * 10, "depth is at most 100"),
        ("normals", lambda x: -x, "normals face"),
        ("normals", lambda x: x * 2, "normals have unit"),
        ("mask", lambda x: x.float(), "mask is bool"),
    ],
)
def test_a_broken_data_set_is_told_the_law(
    key: str, change, named: str, phantom: C3VD, monkeypatch: pytest.MonkeyPatch
) -> None:
    whole = C3VD.__getitem__
    broken = functools.partialmethod(lambda self, i: {**whole(self, i), key: change(whole(self, i)[key])})
    monkeypatch.setattr(C3VD, "__getitem__", broken)
    with refused(AssertionError, None, named):
        check_dataset(phantom)


def test_the_scene_is_what_it_says() -> None:
    batch = scene()
    length = batch["normals"].norm(dim=1, keepdim=True)
    assert torch.allclose(length, batch["mask"].float(), atol=1e-6)
    points = batch["depth"] / batch["rays"][:, 2:] * batch["rays"]
    offset = (points * batch["normals"]).sum(dim=1, keepdim=True)
    for wall, mask, distance in zip(offset, batch["mask"], (-30.0, -40.0), strict=True):
        known = wall[mask]
        assert torch.allclose(known, torch.full_like(known, distance), atol=1e-3)
