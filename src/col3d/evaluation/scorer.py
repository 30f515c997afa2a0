"""The one scorer: predictions of frames become rows, under any number of protocols at once."""

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
        protocol: by which is scored.
        table: of the rows.
        panels: that keep frames, or None.
        mirror: which of the predictions is scored.
        truth: frame by frame in the order of the predictions, where the protocol holds them against something
            else than the batch that they were made from.
    """

    protocol: Protocol
    table: PerFrameTable
    panels: ImagePanels | None = None
    mirror: Mirror = None
    truth: Iterator[Batch] | None = None

    def add(self, batch: Batch, prediction: Prediction, mean_depth: Tensor | None) -> None:
        """Score a batch, and the mean training depth beside it."""
        if self.truth is None:
            self._add(batch, prediction, mean_depth)
            return
        for index in range(len(batch["video"])):
            one: Prediction = {name: values[index : index + 1] for name, values in prediction.items()}  # type: ignore[assignment,index]
            truth = next(self.truth)
            where = (batch["video"][index], int(batch["frame"][index]))
            assert where == (truth["video"][0], int(truth["frame"][0])), (where, truth["video"])
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
    """A scoring for each protocol, into its results.

    Args:
        protocols: by name.
        metrics: options of metrics, by their names.
        results: where the rows of each protocol go.
        truths: see `own_truths`.
        workers: processes that read these.
        device: to compute on.
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
    """Score what a network predicts of the test frames, each process of a training its own part.

    Args:
        network: in evaluation mode.
        frames: whose part `test` is scored.
        device: to compute on.
        scorings: the protocols.
        mean_depth: of the training frames in mm, scored beside as a baseline.
        writers: of predictions, by how they are mirrored.
        limit: of batches; see `FrameDataModule.frames_in_order`.
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
    """Turn predictions into rows, and into files where there are writers; gathers those of all processes.

    Args:
        predicted: batches with what was predicted for them, by how it was mirrored.
        scorings: the protocols.
        mean_depth: of the training frames in mm, scored beside as a baseline.
        writers: of predictions, by how they are mirrored.
    """
    scorings, writers = list(scorings), writers or {}
    with ExitStack() as begun:
        for writer in writers.values():
            begun.callback(writer.give_up)
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
