"""The sum of the tasks' losses, weighted by the lambdas."""

from collections.abc import Callable, Sequence
from typing import cast

import torch
from torch import Tensor, nn

from col3d.batch import Batch, Prediction
from col3d.checks import check_known
from col3d.geometry import PinholeCamera, normals_from_depth
from col3d.losses.consistency import cross_task_l1, cross_task_rmse
from col3d.losses.depth import silog
from col3d.losses.normals import normal_l1, normal_rmse

MaskedLoss = Callable[[Tensor, Tensor, Tensor], Tensor]
DEPTH: dict[str, MaskedLoss] = {"silog": silog}
NORMALS: dict[str, MaskedLoss] = {"l1": normal_l1, "l2": normal_rmse}
CONSISTENCY: dict[str, MaskedLoss] = {"rmse": cross_task_rmse, "l1": cross_task_l1}
GEOMETRIES = ("rays", "pinhole")


class WeightedLoss(nn.Module):
    """total = lambda_1 * depth + lambda_2 * normals + lambda_3 * consistency, for the terms that are chosen.

    Args:
        lambdas: one weight for each term, in that order.
        depth: name of the depth term.
        normals: name of the normal term, or None.
        consistency: name of the cross-task term, or None.
        geometry: how depth becomes normals in the cross-task term: `rays` takes those of the batch;
            `pinhole` the pinhole of the published code, which C3VD's lens is not, at the batch's size.

    Raises:
        ValueError: an unknown name, or not one weight for each term.
    """

    def __init__(
        self,
        lambdas: Sequence[float],
        depth: str = "silog",
        normals: str | None = None,
        consistency: str | None = None,
        geometry: str = "rays",
    ) -> None:
        super().__init__()
        self.geometry = check_known("loss.geometry", geometry, GEOMETRIES)
        self.terms: dict[str, MaskedLoss] = {"depth": DEPTH[check_known("loss.depth", depth, DEPTH)]}
        if normals is not None:
            self.terms["normals"] = NORMALS[check_known("loss.normals", normals, NORMALS)]
        if consistency is not None:
            known = check_known("loss.consistency", consistency, CONSISTENCY)
            self.terms["consistency"] = CONSISTENCY[known]
        if len(lambdas) != len(self.terms):
            raise ValueError(
                f"loss.lambdas: expected {len(self.terms)} weights ({', '.join(self.terms)}), "
                f"got {len(lambdas)}: {list(lambdas)}"
            )
        self.lambdas = dict(zip(self.terms, lambdas, strict=True))

    def forward(self, prediction: Prediction, batch: Batch) -> dict[str, Tensor]:
        """Every term unweighted, and their weighted sum as `total`."""
        with torch.autocast(batch["image"].device.type, enabled=False):
            losses = {
                name: term(*self._arguments(name, prediction, batch)) for name, term in self.terms.items()
            }
            losses["total"] = torch.stack([self.lambdas[name] * loss for name, loss in losses.items()]).sum()
        return losses

    def _arguments(self, term: str, prediction: Prediction, batch: Batch) -> tuple[Tensor, Tensor, Tensor]:
        mask = batch["mask"]
        if term == "depth":
            return prediction["depth"], batch["depth"], mask
        if term == "normals":
            return prediction["normals"], batch["normals"], mask
        derived = normals_from_depth(prediction["depth"], self._rays(batch), mask)
        return prediction["normals"], derived, mask

    def _rays(self, batch: Batch) -> Tensor:
        if self.geometry == "rays":
            return batch["rays"]
        size_hw = cast("tuple[int, int]", tuple(batch["image"].shape[-2:]))
        return PinholeCamera.c3vd().resized(size_hw).rays().to(batch["rays"])
