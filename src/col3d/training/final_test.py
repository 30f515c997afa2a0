"""Final test: score the best epoch on the test split as `col3d evaluate` scores its checkpoint."""

import torch

from col3d.data.datamodule import FrameDataModule
from col3d.errors import UserError
from col3d.evaluation.predict_frames import Mirror
from col3d.evaluation.protocol_truth import own_truths
from col3d.evaluation.results import Results
from col3d.evaluation.scorer import score_network, scorings_of
from col3d.inference.trained_network import TrainedNetwork, network_of
from col3d.io.predictions import PredictionWriter
from col3d.runs.checkpoints import DamagedError, read_checkpoint
from col3d.runs.folder import BEST, PREDICTIONS, RunFolder
from col3d.runs.trained import mean_depth
from col3d.training.options import TrainOptions


def best_network(folder: RunFolder) -> TrainedNetwork:
    """Load the network of the best epoch of this run.

    Raises:
        UserError: its weights are damaged, or of another run.
    """
    path = folder.path / BEST
    try:
        content = read_checkpoint(path)
    except DamagedError as error:
        raise UserError(
            f"the best epoch's weights are damaged, and the same command finds them anew: {error}"
        ) from None
    folder.check_best(content)
    return network_of(content, path)


def score_best(
    options: TrainOptions,
    folder: RunFolder,
    best: TrainedNetwork,
    data: FrameDataModule,
    results: Results,
    device: torch.device,
    predictions: bool,
) -> None:
    """Score the test split under the training's protocol, in float32 whatever the training's precision.

    Args:
        options: options of the training.
        folder: folder of the run, for predictions.
        best: network of the best epoch.
        data: frames with the part `test`.
        results: collector of the scores.
        device: device to compute on.
        predictions: whether to store the predictions.
    """
    name, protocol = options.one_protocol
    truths = own_truths(options.protocol, options.data.tested, options.phantom, "test", options.data.size)
    results.panels.choose(data.lengths()["test"], *data.place())
    scorings = scorings_of(
        options.protocol, options.metrics, {name: results}, truths, options.data.workers, device
    )
    writers: dict[Mirror, PredictionWriter] = {}
    if predictions:
        facts = {"max_depth": options.model.max_depth, "split": "test"}
        writers[protocol.mirror] = PredictionWriter(folder.path / PREDICTIONS, facts)
    mean, limit = mean_depth(best.depth_seen), options.trainer.limit_test_batches
    score_network(best.network, data, device, scorings, mean, writers, limit)
