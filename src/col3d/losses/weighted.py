"""The sum of the tasks' losses, weighted by the lambdas."""

import functools
from collections.abc import Callable, Sequence
from typing import TypeVar

import torch
from torch import Tensor, nn

from col3d.batch import Batch, Prediction, normals_mask
from col3d.checks import check_known
from col3d.geometry import PinholeCamera, normals_from_depth
from col3d.losses.consistency import cross_task_l1, cross_task_rmse
from col3d.losses.depth import silog
from col3d.losses.depth_regression import depth_l1, rmse_log
from col3d.losses.gradients import gradient_direction, gradient_l1
from col3d.losses.normals import normal_l1, normal_rmse

Number = TypeVar("Number", int, float)
MaskedLoss = Callable[[Tensor, Tensor, Tensor], Tensor]
DEPTH: dict[str, MaskedLoss] = {"silog": silog, "rmse_log": rmse_log, "l1": depth_l1}
GRADIENTS: dict[str, MaskedLoss] = {"l1": gradient_l1}
DIRECTIONS: dict[str, MaskedLoss] = {"cosine": gradient_direction}
NORMALS: dict[str, MaskedLoss] = {"l1": normal_l1, "l2": normal_rmse}
CONSISTENCY: dict[str, MaskedLoss] = {"rmse": cross_task_rmse, "l1": cross_task_l1}
TERMS = {
    "depth": DEPTH,
    "gradients": GRADIENTS,
    "directions": DIRECTIONS,
    "normals": NORMALS,
    "consistency": CONSISTENCY,
}
"""Every term with its forms, in the order of the lambdas."""
SPANS = {("depth", "l1"): 2.0, ("gradients", "l1"): 1.0}
"""Forms in mm that are taken of depth scaled to a range of this length: [-1, 1] as published, [0, 1]."""
GEOMETRIES = ("rays", "pinhole")


class WeightedLoss(nn.Module):
    """total = sum of lambda * term over the terms that are chosen, in the order of `TERMS`.

    Args:
        lambdas: one weight for each term, in that order.
        depth: form of the depth term: "silog", "rmse_log", or "l1" of depth scaled to [-1, 1].
        gradients: form of the term of Sobel derivatives, of depth scaled to [0, 1]: "l1" or None.
        directions: form of the term of their patterns: "cosine" or None.
        normals: form of the normal term: "l1", "l2" or None.
        consistency: form of the cross-task term: "rmse", "l1" or None.
        geometry: how depth becomes normals in the cross-task term: `rays` takes those of the batch;
            `pinhole` is the module of the published code: forward differences, and a pinhole, which C3VD's
            lens is not.
        from_epoch: the epoch from which each term counts; all from the first when absent.
        max_depth: depth in mm that scaling takes to the end of its range.

    Raises:
        ValueError: an unknown name, or not one number for each term.
    """

    def __init__(
        self,
        lambdas: Sequence[float],
        depth: str = "silog",
        gradients: str | None = None,
        directions: str | None = None,
        normals: str | None = None,
        consistency: str | None = None,
        geometry: str = "rays",
        from_epoch: Sequence[int] | None = None,
        max_depth: float = 100.0,
    ) -> None:
        super().__init__()
        self.geometry = check_known("loss.geometry", geometry, GEOMETRIES)
        asked = zip(TERMS, (depth, gradients, directions, normals, consistency), strict=True)
        self.terms = {name: _term(name, form, max_depth) for name, form in asked if form is not None}
        self.lambdas = self._each("lambdas", lambdas)
        self.from_epoch = self._each(
            "from_epoch", [0] * len(self.terms) if from_epoch is None else from_epoch
        )

    def forward(self, prediction: Prediction, batch: Batch, epoch: int | None = None) -> dict[str, Tensor]:
        """Every term unweighted, and as `total` the weighted sum of those that count in this epoch."""
        with torch.autocast(batch["image"].device.type, enabled=False):
            losses = {
                name: term(*self._arguments(name, prediction, batch)) for name, term in self.terms.items()
            }
            weighted = [self._weight(name, epoch) * loss for name, loss in losses.items()]
            losses["total"] = torch.stack(weighted).sum()
        return losses

    def _weight(self, name: str, epoch: int | None) -> float:
        # Zero rather than left out: under DDP every prediction has to have a gradient.
        return self.lambdas[name] if epoch is None or epoch >= self.from_epoch[name] else 0.0

    def _each(self, option: str, numbers: Sequence[Number]) -> dict[str, Number]:
        if len(numbers) != len(self.terms):
            raise ValueError(
                f"loss.{option}: expected {len(self.terms)} numbers ({', '.join(self.terms)}), "
                f"got {len(numbers)}: {list(numbers)}"
            )
        return dict(zip(self.terms, numbers, strict=True))

    def _arguments(self, term: str, prediction: Prediction, batch: Batch) -> tuple[Tensor, Tensor, Tensor]:
        mask = batch["mask"]
        if term in ("depth", "gradients", "directions"):
            return prediction["depth"], batch["depth"], mask
        if term == "normals":
            return prediction["normals"], batch["normals"], normals_mask(batch)
        return prediction["normals"], self._derived(prediction["depth"], batch["rays"], mask), mask

    def _derived(self, depth: Tensor, rays: Tensor, mask: Tensor) -> Tensor:
        if self.geometry == "rays":
            return normals_from_depth(depth, rays, mask)
        pinhole = PinholeCamera.c3vd_published((depth.shape[-2], depth.shape[-1])).rays().to(rays)
        return normals_from_depth(depth, pinhole, mask, differences="forward")


def _term(name: str, form: str, max_depth: float) -> MaskedLoss:
    term = TERMS[name][check_known(f"loss.{name}", form, TERMS[name])]
    if (name, form) not in SPANS:
        return term
    return functools.partial(_times, SPANS[name, form] / max_depth, term)


def _times(factor: float, term: MaskedLoss, preds: Tensor, target: Tensor, mask: Tensor) -> Tensor:
    return factor * term(preds, target, mask)
