"""Scorer: turns predictions of frames into rows, under any number of protocols at once."""

from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import ExitStack
from dataclasses import dataclass

import torch
from torch import Tensor, nn

from col3d.batch import Batch, Prediction
from col3d.data.datamodule import FrameDataModule, Frames
from col3d.evaluation.options import ProtocolOptions, build_protocol
from col3d.evaluation.panels import ImagePanels
from col3d.evaluation.per_frame_table import PerFrameTable
from col3d.evaluation.predict_frames import Mirror, predict_frames, write_batch
from col3d.evaluation.protocol_truth import one_by_one
from col3d.evaluation.results import Results
from col3d.io.predictions import PredictionWriter
from col3d.metrics import Protocol
from col3d.metrics.options import MetricOptions


@dataclass
class Scoring:
    """One protocol, and where its scores go.

    Attributes:
        protocol: protocol of the scores.
        table: table that receives the rows.
        panels: panels that keep frames, or None.
        mirror: way of mirroring whose predictions are scored.
        truth: batches of one frame in the order of the predictions, if the protocol compares with other
            frames than the batch that they were made from; else None.
    """

    protocol: Protocol
    table: PerFrameTable
    panels: ImagePanels | None = None
    mirror: Mirror = None
    truth: Iterator[Batch] | None = None

    def add(self, batch: Batch, prediction: Prediction, mean_depth: Tensor | None) -> None:
        """Score a batch, and the mean training depth as a baseline."""
        if self.truth is None:
            self._add(batch, prediction, mean_depth)
            return
        for index in range(len(batch["video"])):
            one: Prediction = {name: values[index : index + 1] for name, values in prediction.items()}  # type: ignore[assignment,index]
            truth = next(self.truth)
            scored = (batch["video"][index], int(batch["frame"][index]))
            assert scored == (truth["video"][0], int(truth["frame"][0])), (scored, truth["video"])
            self._add(truth, one, mean_depth)

    def _add(self, batch: Batch, prediction: Prediction, mean_depth: Tensor | None) -> None:
        values, baseline = self.protocol.score(prediction, batch), {}
        if mean_depth is not None:
            constant: Prediction = {"depth": mean_depth.to(batch["depth"].device).expand_as(batch["depth"])}
            baseline = self.protocol.score(constant, batch, validation=True)
        self.table.add(batch, values, baseline)
        if self.panels is not None:
            self.panels.keep(batch, prediction, values)


def scorings_of(
    protocols: Mapping[str, ProtocolOptions],
    metrics: MetricOptions,
    results: Mapping[str, Results],
    truths: Mapping[str, Frames | None],
    workers: int,
    device: torch.device,
) -> list[Scoring]:
    """Make a scoring for each protocol.

    Args:
        protocols: options of protocols by name.
        metrics: options of metrics by name.
        results: results of each protocol, which receive the rows.
        truths: frames of protocols with their own ground truth; see `own_truths`.
        workers: number of processes that read these frames.
        device: device to compute on.
    """
    return [
        Scoring(
            build_protocol(name, options, metrics),
            results[name].table,
            None if options.resolution == "native" else results[name].panels,
            options.mirror,
            one_by_one(truths[name], workers, device),
        )
        for name, options in protocols.items()
    ]


def score_network(
    network: nn.Module,
    frames: FrameDataModule,
    device: torch.device,
    scorings: Sequence[Scoring],
    mean_depth: Tensor | None = None,
    writers: Mapping[Mirror, PredictionWriter] | None = None,
    limit: int | float | None = None,
) -> None:
    """Predict and score the test frames; each process of a training does its own share.

    Args:
        network: network in evaluation mode.
        frames: frames whose part `test` is scored.
        device: device to compute on.
        scorings: the protocols.
        mean_depth: mean depth of the training frames in mm, scored as a baseline.
        writers: writers of predictions by way of mirroring.
        limit: limit of batches; see `FrameDataModule.frames_in_order`.
    """
    mirrors = [*(scoring.mirror for scoring in scorings), *(writers or {})]
    batches = frames.frames_in_order("test", device, limit)
    score(predict_frames(network.to(device), batches, mirrors), scorings, mean_depth, writers)


def score(
    predicted: Iterable[tuple[Batch, Mapping[Mirror, Prediction]]],
    scorings: Iterable[Scoring],
    mean_depth: Tensor | None = None,
    writers: Mapping[Mirror, PredictionWriter] | None = None,
) -> None:
    """Score predictions, and write them if there are writers; gather the rows of all processes.

    Args:
        predicted: batches with their predictions by way of mirroring.
        scorings: the protocols.
        mean_depth: mean depth of the training frames in mm, scored as a baseline.
        writers: writers of predictions by way of mirroring.
    """
    scorings, writers = list(scorings), writers or {}
    with ExitStack() as stack:
        for writer in writers.values():
            stack.callback(writer.give_up)
        with torch.inference_mode():
            for batch, predictions in predicted:
                for scoring in scorings:
                    scoring.add(batch, predictions[scoring.mirror], mean_depth)
                for mirror, writer in writers.items():
                    write_batch(writer, batch, predictions[mirror])
        for writer in writers.values():
            writer.finish()
    for scoring in scorings:
        scoring.table.gather()
