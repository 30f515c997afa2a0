"""Check functions, one for each kind of part; each names the law that is broken."""

import copy
import pickle
from collections.abc import Callable, Sequence

import torch
from torch import Tensor, nn

from col3d.batch import Batch, Prediction
from col3d.data.datasets.frame_set import FrameSet
from col3d.geometry import normals_from_depth
from col3d.testing.scene import Size, scene

JUNK = 1e6
"""Value of pixels that do not count."""


def check_network(
    factory: Callable[[], nn.Module], sizes: Sequence[Size] = ((64, 96), (65, 97)), seed: int = 0
) -> None:
    """Check that a network predicts maps of the image's size, alike in any batch, learns and can be stored.

    Args:
        factory: makes the network.
        sizes: heights and widths of images that it has to support.
        seed: seed of its weights.

    Raises:
        AssertionError: names the law.
    """
    torch.manual_seed(seed)
    network = factory()
    for size_hw in sizes:
        _check_prediction(_predicted(network, scene(size_hw)), size_hw)
    batch = scene(sizes[0])
    whole = _predicted(network, batch)
    _alike(
        whole, _predicted(network, batch), "the same image gives the same prediction in eval mode", exact=True
    )
    single = [_predicted(network, _one(batch, i)) for i in range(len(batch["image"]))]
    joined = {key: torch.cat([one[key] for one in single]) for key in ("depth", "normals") if key in whole}
    _alike(whole, joined, "a frame is predicted alike alone and in a batch")
    _alike(whole, _predicted(copy.deepcopy(network), batch), "a copy predicts the same", exact=True)
    other = factory()
    other.load_state_dict(network.state_dict())
    _alike(whole, _predicted(other, batch), "state_dict holds all that the prediction depends on", exact=True)
    _check_learning(network, batch)


def check_loss(
    term: Callable[[Prediction, Batch], Tensor], needs: Sequence[str] = ("depth",), atol: float = 1e-4
) -> None:
    """Check that a term is zero at the truth, finite everywhere, and independent of masked pixels.

    Args:
        term: (prediction, batch) -> scalar.
        needs: maps of a prediction that it uses: "depth", "normals".
        atol: tolerance of its value at the truth.

    Raises:
        AssertionError: names the law.
    """
    batch = scene()
    truth: Prediction = {"depth": batch["depth"].clamp(min=1.0), "normals": batch["normals"]}
    at_truth = term(truth, batch)
    assert at_truth.ndim == 0, f"a term is a scalar: got {tuple(at_truth.shape)}"
    assert abs(float(at_truth)) <= atol, f"a term is zero at the truth: got {float(at_truth)}"
    guess = _guess(batch)
    cost, gradients = _differentiated(term, guess, batch, needs)
    assert cost.isfinite(), f"a term is finite: got {float(cost)}"
    for key, gradient in gradients.items():
        assert gradient.isfinite().all(), f"the gradient by {key} is finite"
        assert gradient.any(), f"the gradient by {key} is not zero away from the truth"
        assert not gradient[~batch["mask"].expand_as(gradient)].any(), f"masked {key} gets no gradient"
    junk = {**batch, "depth": torch.where(batch["mask"], batch["depth"], JUNK)}
    other = term(guess, junk)  # type: ignore[arg-type]
    assert torch.equal(cost, other), "depth that the mask leaves out changes nothing"
    nothing: Batch = {**batch, "mask": torch.zeros_like(batch["mask"])}
    empty, gradients = _differentiated(term, guess, nothing, needs)
    assert empty.isfinite(), f"a term of no pixels is finite: got {float(empty)}"
    assert all(g.isfinite().all() for g in gradients.values()), "its gradient of no pixels is finite"


def check_metric(
    metric: Callable[[Tensor, Tensor, Tensor], Tensor], task: str = "depth", at_truth: float | None = None
) -> None:
    """Check that a metric gives one number a frame, independent of the batch and of masked pixels.

    Args:
        metric: (preds, target, mask) -> (b,).
        task: "depth" in mm, or "normals".
        at_truth: its value where `preds` equals `target`.

    Raises:
        AssertionError: names the law.
    """
    batch = scene(frames=3)
    target, mask = batch[task], batch["mask"]  # type: ignore[literal-required]
    preds = _guess(batch)[task]  # type: ignore[literal-required]
    values = metric(preds, target, mask)
    assert values.shape == (3,), f"a metric gives one value a frame, (3,): got {tuple(values.shape)}"
    assert values.isfinite().all(), f"a metric is finite where pixels count: got {values.tolist()}"
    single = torch.cat([metric(preds[i : i + 1], target[i : i + 1], mask[i : i + 1]) for i in range(3)])
    assert torch.allclose(values, single, rtol=1e-6), "a frame has the same value alone and in a batch"
    junk = torch.where(mask, target, JUNK if task == "depth" else 0.5)
    assert torch.equal(values, metric(preds, junk, mask)), "what the mask leaves out changes nothing"
    if at_truth is not None:
        best = metric(target, target, mask)
        assert torch.allclose(best, torch.full_like(best, at_truth), atol=1e-6), (
            f"at the truth a metric is {at_truth}: got {best.tolist()}"
        )


def check_dataset(frames: FrameSet) -> None:
    """Check that frames of a data set are in standard units and axes, and the same after pickling.

    Args:
        frames: a data set with at least one frame.

    Raises:
        AssertionError: names the law and the frame.
    """
    assert len(frames) > 0, "a data set has frames"
    height, width = frames.camera.size_hw
    for index in (0, len(frames) - 1):
        item = frames[index]
        where = f"frame {item['frame']} of {item['video']}"
        image, depth, mask, rays = (item[key] for key in ("image", "depth", "mask", "rays"))
        assert image.shape == (3, height, width), f"{where}: image is (3, {height}, {width})"
        assert 0 <= image.min() <= image.max() <= 1, f"{where}: image is in [0, 1]"
        assert depth.shape == mask.shape == (1, height, width), f"{where}: depth, mask are (1, h, w)"
        assert mask.dtype == torch.bool, f"{where}: mask is bool"
        assert (depth[mask] > 0).all(), f"{where}: depth that counts is above 0 mm"
        assert not depth[~mask].any(), f"{where}: depth that does not count is 0"
        assert (depth[mask] <= frames.max_depth).all(), f"{where}: depth is at most {frames.max_depth} mm"
        if "normals" in item:
            _check_normals(item["normals"], rays, where)
    again = pickle.loads(pickle.dumps(frames))[0]
    for key, value in frames[0].items():
        same = torch.equal(value, again[key]) if isinstance(value, Tensor) else value == again[key]
        assert same, f"{key} of the first frame is the same after pickling, as loaders need"


def _predicted(network: nn.Module, batch: Batch) -> Prediction:
    with torch.no_grad():
        prediction: Prediction = network.eval()(batch["image"], batch["rays"])
    return prediction


def _check_prediction(prediction: Prediction, size_hw: Size) -> None:
    depth = prediction["depth"]
    assert depth.shape == (2, 1, *size_hw), (
        f"depth is (2, 1, {size_hw[0]}, {size_hw[1]}): got {tuple(depth.shape)}"
    )
    assert depth.isfinite().all(), "depth is finite"
    assert (depth > 0).all(), f"depth is above 0 mm: got {float(depth.min())}"
    if "normals" in prediction:
        normals = prediction["normals"]
        assert normals.shape == (2, 3, *size_hw), f"normals are (2, 3, h, w): got {tuple(normals.shape)}"
        length = normals.norm(dim=1)
        assert torch.allclose(length, torch.ones_like(length), atol=1e-3), "normals have unit length"


def _check_learning(network: nn.Module, batch: Batch) -> None:
    network.train().zero_grad()
    prediction = network(batch["image"], batch["rays"])
    outputs = [prediction[key] for key in ("depth", "normals") if key in prediction]
    torch.stack([(output * torch.randn_like(output)).sum() for output in outputs]).sum().backward()
    for name, parameter in network.named_parameters():
        if parameter.requires_grad:
            gradient = parameter.grad
            assert gradient is not None, f"every parameter has a gradient, as DDP needs: {name} has none"
            assert gradient.isfinite().all(), f"gradients are finite: that of {name} is not"
    with torch.autocast("cpu", torch.bfloat16):
        half = network.eval()(batch["image"], batch["rays"])
    assert half["depth"].isfinite().all(), "depth is finite under bfloat16 autocast"


def _alike(one: Prediction, other: object, law: str, exact: bool = False) -> None:
    assert isinstance(other, dict)
    for key in ("depth", "normals"):
        if key in one:
            first, second = one[key], other[key]
            same = (
                torch.equal(first, second) if exact else torch.allclose(first, second, rtol=1e-3, atol=1e-3)
            )
            assert same, f"{law}: {key} differs by {float((first - second).abs().max()):g}"


def _one(batch: Batch, index: int) -> Batch:
    return {key: value[index : index + 1] for key, value in batch.items()}  # type: ignore[index,return-value]


def _guess(batch: Batch) -> Prediction:
    """Depth with errors of up to a fifth, and the normals of this depth."""
    noise = torch.rand(batch["depth"].shape, generator=torch.Generator().manual_seed(1))
    depth = batch["depth"].clamp(min=1.0) * (0.8 + 0.4 * noise)
    normals = normals_from_depth(depth, batch["rays"], torch.ones_like(batch["mask"]))
    return {"depth": depth, "normals": normals}


def _differentiated(
    term: Callable[[Prediction, Batch], Tensor], guess: Prediction, batch: Batch, needs: Sequence[str]
) -> tuple[Tensor, dict[str, Tensor]]:
    """The cost, and its gradients by the needed maps; zero where it does not depend on them."""
    leaves = {key: guess[key].clone().requires_grad_() for key in needs}  # type: ignore[literal-required]
    cost = term({**guess, **leaves}, batch)  # type: ignore[typeddict-item]
    if cost.requires_grad:
        cost.backward()
    gradients = {
        key: torch.zeros_like(leaf) if leaf.grad is None else leaf.grad for key, leaf in leaves.items()
    }
    return cost.detach(), gradients


def _check_normals(normals: Tensor, rays: Tensor, where: str) -> None:
    length = normals.norm(dim=0)
    known = length > 0
    assert torch.allclose(length[known], torch.ones_like(length[known]), atol=1e-3), (
        f"{where}: normals have unit length, or are 0 where unknown"
    )
    facing = (normals * rays).sum(dim=0)[known] < 0
    assert facing.float().mean() > 0.99, f"{where}: normals face the camera, n . ray < 0"
