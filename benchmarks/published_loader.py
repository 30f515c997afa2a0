"""A stand-in for the loaders that this field's programs publish, for timing alone.

They decode each file whole and, in the worker and at full size, turn it by up to a degree, make it float,
mirror it and change its gamma, brightness and colours with probability one half each, normalise the image,
and resize last.
Written from that description; its values are used for nothing.
"""

import random

import cv2
import numpy as np
import torch
from PIL import Image
from torch import Tensor
from torch.utils.data import Dataset
from torchvision.transforms import InterpolationMode
from torchvision.transforms import functional as transform

from col3d.data.datasets.frame_set import FrameSet
from col3d.io.formats import IMAGE_FORMATS

MAX_CODE = 65535
MEAN, STD = (0.485, 0.456, 0.406), (0.229, 0.224, 0.225)
"""Of ImageNet."""
MAX_DEPTH = 100.0


class PublishedLoader(Dataset[dict[str, Tensor]]):
    """Frames as the published loaders make them.

    Args:
        frames: whose files are read, normals among them.
        size_hw: of the items.
        degrees: largest rotation, either way.
        chance: that a frame is mirrored, and that its colours are changed.
    """

    def __init__(
        self, frames: FrameSet, size_hw: tuple[int, int], degrees: float = 1.0, chance: float = 0.5
    ) -> None:
        self.files = [frame.files for frame in frames.frames]
        self.size_hw, self.degrees, self.chance = list(size_hw), degrees, chance

    def __len__(self) -> int:
        return len(self.files)

    def __getitem__(self, index: int) -> dict[str, Tensor]:
        files = self.files[index]
        image: Image.Image = Image.open(files["color"], formats=IMAGE_FORMATS)
        depth: Image.Image = Image.open(files["depth"], formats=IMAGE_FORMATS)
        stored = cv2.imread(str(files["normals"]), cv2.IMREAD_UNCHANGED)
        assert stored is not None
        normals = stored[..., ::-1].astype(np.float32) / MAX_CODE * 2 - 1

        angle = random.uniform(-self.degrees, self.degrees)
        image = image.rotate(angle, resample=Image.Resampling.BILINEAR)
        depth = depth.rotate(angle, resample=Image.Resampling.NEAREST)
        height, width = normals.shape[:2]
        turn = cv2.getRotationMatrix2D(((width - 1) / 2, (height - 1) / 2), angle, 1.0)
        turned = cv2.warpAffine(normals, turn, (width, height), flags=cv2.INTER_LINEAR)

        maps = {
            "image": np.asarray(image, np.float32) / 255,
            "depth": np.asarray(depth, np.float32)[..., None] / MAX_CODE * MAX_DEPTH,
            "normals": turned,
        }
        if random.random() < self.chance:
            maps = {name: values[:, ::-1].copy() for name, values in maps.items()}
        if random.random() < self.chance:
            maps["image"] = _jittered(maps["image"])
        item = {name: torch.from_numpy(values.transpose(2, 0, 1)) for name, values in maps.items()}
        item["image"] = transform.normalize(item["image"], list(MEAN), list(STD))
        return {
            "image": transform.resize(item["image"], self.size_hw),
            "depth": transform.resize(item["depth"], self.size_hw, InterpolationMode.NEAREST),
            "normals": transform.resize(item["normals"], self.size_hw),
        }


def _jittered(image: np.ndarray) -> np.ndarray:
    """Gamma, brightness and a gain for each colour, at full size."""
    changed = image ** random.uniform(0.9, 1.1) * random.uniform(0.75, 1.25)
    changed = changed * np.array([random.uniform(0.9, 1.1) for _ in range(3)], np.float32)
    clipped: np.ndarray = changed.clip(0, 1).astype(np.float32)
    return clipped
