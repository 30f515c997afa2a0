"""Base of networks: normalise, pad, estimate depth, add normals, crop."""

import itertools
from abc import ABC, abstractmethod

import torch
from jaxtyping import Float
from torch import Tensor, nn

from col3d.batch import Prediction
from col3d.errors import OptionError
from col3d.layers.normal_decoder import NORMAL_FRAMES, Features, NormalDecoder
from col3d.nearest_names import check_known

IMAGENET_MEAN = (0.485, 0.456, 0.406)
IMAGENET_STD = (0.229, 0.224, 0.225)


def predicts(network: nn.Module, otherwise: tuple[str, ...] = ("depth",)) -> tuple[str, ...]:
    """Tasks that a network predicts: its `tasks`, or a default where it has none."""
    return tuple(getattr(network, "tasks", otherwise))


def parameters_of(network: nn.Module) -> int:
    """Number of parameters."""
    return sum(parameter.numel() for parameter in network.parameters())


def measured_tasks(network: nn.Module) -> tuple[str, ...]:
    """Tasks that are measured for a network: depth, and normals if it predicts them."""
    return ("depth", "normals") if "normals" in predicts(network) else ("depth",)


def needs_rays(network: nn.Module) -> bool:
    """Whether a network needs the camera's rays: its `needs_rays`, or False where it has none."""
    return bool(getattr(network, "needs_rays", False))


def device_of(network: nn.Module) -> torch.device:
    """Device of a network's parameters or buffers; the CPU for a network without any."""
    values = next(itertools.chain(network.parameters(), network.buffers()), None)
    return torch.device("cpu") if values is None else values.device


class DepthNetwork(nn.Module, ABC):
    """Image -> `Prediction`, at any size: depth, and normals where a decoder for them is added.

    Subclasses estimate depth and offer `Features` to that decoder.

    Attributes:
        feature_channels: channels of the maps at 1/2, 1/4 and 1/8 that subclasses offer.
        memory_format: memory format of images, and of weights where `col3d.models.create` makes the network.
        multiple: the sides of the padded image are multiples of this, in pixels.
        normal_decoder: the decoder of those maps to normals, or None.
        skipped_names: tensors of a published state dict that were left out; see `col3d.models.published`.
    """

    feature_channels: tuple[int, int, int]
    multiple: int = 32
    memory_format: torch.memory_format = torch.channels_last
    normal_decoder: NormalDecoder | None
    skipped_names: tuple[str, ...] = ()
    mean: Tensor
    std: Tensor

    def __init__(self) -> None:
        super().__init__()
        self.normal_decoder = None
        self.register_buffer("mean", torch.tensor(IMAGENET_MEAN).view(1, 3, 1, 1), persistent=False)
        self.register_buffer("std", torch.tensor(IMAGENET_STD).view(1, 3, 1, 1), persistent=False)

    @property
    def tasks(self) -> tuple[str, ...]:
        """Tasks that are predicted: "depth", and "normals" where there is a decoder for them."""
        return ("depth",) if self.normal_decoder is None else ("depth", "normals")

    @property
    def needs_rays(self) -> bool:
        """Whether the prediction depends on the camera's rays."""
        return self.normal_decoder is not None and self.normal_decoder.frame.needs_rays

    def add_normals(self, width: int = 512, frame: str = "camera") -> None:
        """Add a decoder for normals on the network's features.

        Args:
            width: F, which the decoder's sizes scale from; 512 is published.
            frame: "camera", for normals anywhere on the sphere, or "ray", for those that face the camera
                along each pixel's own ray, which `forward` then has to be given.

        Raises:
            ValueError: the frame is unknown, or the width is not a positive multiple of 32.
        """
        if width <= 0 or width % 32:
            raise OptionError(f"model.width: normals need a positive multiple of 32, got {width}")
        known = NORMAL_FRAMES[check_known("model.normal_frame", frame, NORMAL_FRAMES)]
        self.normal_decoder = NormalDecoder(self.feature_channels, width, known)

    def forward(
        self, image: Float[Tensor, "b 3 h w"], rays: Float[Tensor, "*b 3 h w"] | None = None
    ) -> Prediction:
        """RGB in [0, 1] -> the prediction at each of its pixels.

        Args:
            image: frames of any size.
            rays: unit viewing rays, one map for all frames or one for each; without effect on networks whose
                `needs_rays` is False.

        Raises:
            ValueError: the rays are needed and absent, or of another size.
        """
        return self.forward_normalised((image - self.mean) / self.std, rays)

    def forward_normalised(
        self, x: Float[Tensor, "b 3 h w"], rays: Float[Tensor, "*b 3 h w"] | None = None
    ) -> Prediction:
        """The prediction for an image that is normalised by ImageNet's mean and standard deviation."""
        if self.needs_rays and rays is None:
            raise ValueError("rays: normals in the frame of the ray need the rays of the camera")
        if rays is not None and rays.shape[-2:] != x.shape[-2:]:
            given, wanted = (tuple(values.shape[-2:]) for values in (rays, x))
            raise ValueError(f"rays: expected those of an image of {wanted} pixels, got {given}")
        height, width = x.shape[-2:]
        padding = (0, self._whole(width) - width, 0, self._whole(height) - height)
        rays = None if rays is None else rays.expand(x.shape[0], -1, -1, -1)
        if torch.compiler.is_exporting() or any(padding):
            x = nn.functional.pad(x, padding, mode="replicate")
            rays = None if rays is None else nn.functional.pad(rays, padding, mode="replicate")
        prediction = self.predict(x.contiguous(memory_format=self.memory_format), rays)
        cropped: Prediction = {"depth": prediction["depth"][..., :height, :width]}
        if "normals" in prediction:
            cropped["normals"] = prediction["normals"][..., :height, :width]
        return cropped

    def _whole(self, length: int) -> int:
        """Side of the padded image, in a form that an exporter recognises as a multiple."""
        return (length + self.multiple - 1) // self.multiple * self.multiple

    def predict(
        self, x: Float[Tensor, "b 3 h w"], rays: Float[Tensor, "b 3 h w"] | None = None
    ) -> Prediction:
        """The prediction for a normalised image whose sides are multiples of `multiple`."""
        depth, features = self.estimate(x)
        if self.normal_decoder is None:
            return {"depth": depth}
        return {"depth": depth, "normals": self.normal_decoder(features, rays)}

    @abstractmethod
    def estimate(self, x: Float[Tensor, "b 3 h w"]) -> tuple[Float[Tensor, "b 1 h w"], Features]:
        """Depth in mm for such an image, and the features for other decoders."""
