"""A network of three convolutions."""

from typing import Annotated

from pydantic import Field
from torch import Tensor, nn

from col3d.batch import Prediction
from col3d.registry import register_model


@register_model("tinynet", loss="silog")
class TinyNet(nn.Module):
    """Three convolutions at full resolution.

    Args:
        width: channels.
        max_depth: upper bound of the depth in mm.
    """

    def __init__(self, width: Annotated[int, Field(gt=0)] = 8, max_depth: float = 100.0) -> None:
        super().__init__()
        self.max_depth = max_depth
        self.layers = nn.Sequential(
            nn.Conv2d(3, width, 3, padding=1),
            nn.ReLU(),
            nn.Conv2d(width, width, 3, padding=1),
            nn.ReLU(),
            nn.Conv2d(width, 1, 3, padding=1),
        )

    def forward(self, image: Tensor, rays: Tensor | None = None) -> Prediction:
        """RGB (b, 3, h, w) in [0, 1] and viewing rays -> depth (b, 1, h, w) in mm."""
        return {"depth": self.max_depth * self.layers(image).sigmoid()}
