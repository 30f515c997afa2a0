"""Prediction of the frames of a data set, batch by batch, in float32."""

from collections.abc import Iterable, Iterator, Mapping

import torch
from torch import nn

from col3d.batch import Batch, Prediction, check_prediction
from col3d.errors import DivergedError
from col3d.evaluation.mirror import mirror_average
from col3d.io.predictions import PredictionWriter

Mirror = str | None
"""How a prediction is averaged with that of the mirrored frame: "mean", "ramp", or None for not at all."""


def predict_frames(
    network: nn.Module, batches: Iterable[Batch], mirrors: Iterable[Mirror] = (None,)
) -> Iterator[tuple[Batch, Mapping[Mirror, Prediction]]]:
    """Yield each batch with the network's predictions, by way of mirroring.

    Args:
        network: network in evaluation mode, on the device of the batches.
        batches: batches of frames with their rays.
        mirrors: ways of mirroring.

    Raises:
        UserError: a prediction is not what a network has to return.
        DivergedError: a prediction is not finite; names the frame.
    """
    mirrors = tuple(dict.fromkeys(mirrors))

    def predict(batch: Batch) -> Prediction:
        prediction: Prediction = network(batch["image"], batch["rays"])
        check_prediction(prediction, batch["image"], type(network).__name__)
        return known_maps(prediction)

    for batch in batches:
        with torch.inference_mode():
            predicted = {
                mirror: predict(batch) if mirror is None else mirror_average(predict, batch, mirror)
                for mirror in mirrors
            }
        for maps in predicted.values():
            _check_finite(maps, batch)
        yield batch, predicted


def _check_finite(prediction: Prediction, batch: Batch) -> None:
    for name, values in prediction.items():
        broken = ~values.isfinite().flatten(1).all(dim=1)  # type: ignore[attr-defined]
        if broken.any():
            first = int(broken.nonzero()[0])
            raise DivergedError(
                f"{name} of {batch['video'][first]}:{int(batch['frame'][first])} is not finite in the test: "
                "weights are damaged, or their training diverged; lower optimizer.lr, or set "
                "trainer.gradient_clip"
            )


def known_maps(prediction: Prediction) -> Prediction:
    """Select depth and normals of a prediction; networks may return more for losses."""
    maps: Prediction = {"depth": prediction["depth"]}
    if "normals" in prediction:
        maps["normals"] = prediction["normals"]
    return maps


def write_batch(writer: PredictionWriter, batch: Batch, prediction: Prediction) -> None:
    """Add the predictions for a batch to those on disk."""
    maps = {
        name: values.movedim(1, -1).float().cpu().numpy()  # type: ignore[attr-defined]
        for name, values in prediction.items()
    }
    for i, (video, frame) in enumerate(zip(batch["video"], batch["frame"].tolist(), strict=True)):
        normals = maps["normals"][i] if "normals" in maps else None
        writer.add(video, frame, maps["depth"][i][..., 0], normals)
