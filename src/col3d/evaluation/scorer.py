"""Scorer: turns predictions of frames into rows, under any number of protocols at once."""

from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import ExitStack
from dataclasses import dataclass, field
from typing import Any

import torch
from lightning.fabric.utilities import move_data_to_device
from torch import Tensor, nn

from col3d.batch import Batch, Prediction
from col3d.data.datamodule import FrameDataModule, Frames
from col3d.evaluation.options import ProtocolOptions
from col3d.evaluation.panels import ImagePanels
from col3d.evaluation.per_frame_table import PerFrameTable
from col3d.evaluation.predict_frames import Mirror, predict_frames, write_batch
from col3d.evaluation.protocol_truth import one_by_one
from col3d.evaluation.results import Results
from col3d.io.predictions import PredictionWriter
from col3d.metrics import Protocol
from col3d.metrics.alignment import Aligned
from col3d.metrics.options import MetricOptions

SCORED = ("depth", "normals", "mask", "video", "frame")
"""What of a frame is needed to score it."""


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
        video: frames of the current video, each as a batch of one with its prediction, if the protocol aligns
            the predictions of a video together.
    """

    protocol: Protocol
    table: PerFrameTable
    panels: ImagePanels | None = None
    mirror: Mirror = None
    truth: Iterator[Batch] | None = None
    video: list[tuple[Batch, Prediction]] = field(default_factory=list)

    def add(self, batch: Batch, prediction: Prediction, mean_depth: Tensor | None) -> None:
        """Score a batch, and the mean training depth as a baseline."""
        if self.truth is None and not self.protocol.aligns_videos:
            self._add(batch, prediction, mean_depth)
            return
        for index in range(len(batch["video"])):
            frame, one = _frame(batch, index), _frame(prediction, index)
            if self.truth is not None:
                truth = next(self.truth)
                scored = (frame["video"][0], int(frame["frame"][0]))
                assert scored == (truth["video"][0], int(truth["frame"][0])), (scored, truth["video"])
                frame = truth
            if not self.protocol.aligns_videos:
                self._add(frame, one, mean_depth)
                continue
            if self.video and self.video[0][0]["video"] != frame["video"]:
                self.finish(mean_depth)
            # without images, which of a whole video take gigabytes
            kept = {name: frame[name] for name in SCORED if name in frame}
            self.video.append(move_data_to_device((kept, one), "cpu"))

    def finish(self, mean_depth: Tensor | None) -> None:
        """Score the frames of a video whose predictions are aligned together."""
        if not self.video:
            return
        aligned = self.protocol.of_video((prediction, batch) for batch, prediction in self.video)
        constant = None
        if mean_depth is not None:
            means = ((_constant(mean_depth, batch), batch) for batch, _ in self.video)
            constant = self.protocol.of_video(means)
        for batch, prediction in self.video:
            self._add(batch, prediction, mean_depth, aligned, constant)
        self.video = []

    def _add(
        self,
        batch: Batch,
        prediction: Prediction,
        mean_depth: Tensor | None,
        aligned: Aligned | None = None,
        constant: Aligned | None = None,
    ) -> None:
        values, baseline = self.protocol.score(prediction, batch, aligned=aligned), {}
        if mean_depth is not None:
            mean = _constant(mean_depth, batch)
            baseline = self.protocol.score(
                mean, batch, validation=self.protocol.names is None, aligned=constant
            )
        self.table.add(batch, values, baseline)
        if self.panels is not None:
            self.panels.keep(batch, prediction, values)


def _frame(maps: Any, index: int) -> Any:
    """One frame of a batch or of a prediction, as a batch of one."""
    return {name: values[index : index + 1] for name, values in maps.items()}


def _constant(mean_depth: Tensor, batch: Batch) -> Prediction:
    return {"depth": mean_depth.to(batch["depth"].device).expand_as(batch["depth"])}


def build_protocol(name: str, options: ProtocolOptions, metrics: MetricOptions) -> Protocol:
    """Build the protocol of its options; `metrics` are options of metrics, over the protocol's own."""
    low, high = options.truth_range
    clip = None if options.clip is None else (options.clip[0], options.clip[1])
    return Protocol(
        name,
        scaling=options.scaling,
        scaling_of=options.scaling_of,
        scaling_over=options.scaling_over,
        truth_range=(low, high),
        cosine_epsilon=options.cosine_epsilon,
        normal_axes=options.normal_axes,
        clip=clip,
        positive=options.positive,
        epsilon=options.epsilon,
        names=None if options.metrics is None else tuple(options.metrics),
        metrics={**options.metric_options, **metrics},
    )


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
            results[name].panels if options.keeps_panels else None,
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
            for scoring in scorings:
                scoring.finish(mean_depth)
        for writer in writers.values():
            writer.finish()
    for scoring in scorings:
        scoring.table.gather()
