"""What every network does around its layers: normalise the image, pad it, crop the prediction."""

from abc import ABC, abstractmethod
from typing import ClassVar

import torch
from jaxtyping import Float
from torch import Tensor, nn

from col3d.batch import Prediction

IMAGENET_MEAN = (0.485, 0.456, 0.406)
IMAGENET_STD = (0.229, 0.224, 0.225)


class ImageNetwork(nn.Module, ABC):
    """Image -> `Prediction`, at any size. Subclasses say what they predict and from which sizes.

    Attributes:
        tasks: what is predicted: "depth", and "normals" for the networks that have them.
        multiple: what the sides of the padded image are a multiple of, in pixels.
        skipped_names: tensors of a published state dict that were left out; see `col3d.models.published`.
    """

    tasks: ClassVar[tuple[str, ...]]
    multiple: ClassVar[int] = 32
    skipped_names: tuple[str, ...] = ()
    mean: Tensor
    std: Tensor

    def __init__(self) -> None:
        super().__init__()
        self.register_buffer("mean", torch.tensor(IMAGENET_MEAN).view(1, 3, 1, 1), persistent=False)
        self.register_buffer("std", torch.tensor(IMAGENET_STD).view(1, 3, 1, 1), persistent=False)

    def forward(self, image: Float[Tensor, "b 3 h w"]) -> Prediction:
        """RGB in [0, 1] -> what is predicted at each of its pixels."""
        return self.forward_normalised((image - self.mean) / self.std)

    def forward_normalised(self, x: Float[Tensor, "b 3 h w"]) -> Prediction:
        """The same for an image from which ImageNet's mean is taken, over its standard deviation."""
        height, width = x.shape[-2:]
        padding = (0, -width % self.multiple, 0, -height % self.multiple)
        prediction = self.predict(nn.functional.pad(x, padding, mode="replicate"))
        cropped: Prediction = {"depth": prediction["depth"][..., :height, :width]}
        if "normals" in prediction:
            cropped["normals"] = prediction["normals"][..., :height, :width]
        return cropped

    @abstractmethod
    def predict(self, x: Float[Tensor, "b 3 h w"]) -> Prediction:
        """The prediction for a normalised image whose sides are multiples of `multiple`."""
