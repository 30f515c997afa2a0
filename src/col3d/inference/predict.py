"""`col3d predict`: depth and normals of any images, read, predicted and written batch by batch."""

import itertools
import time
from collections.abc import Iterable, Iterator, Mapping
from pathlib import Path
from typing import Any

import numpy as np
import torch

from col3d.data.ahead import ahead
from col3d.data.files.images import ImageSource, SourceImage, image_source
from col3d.data.processes import frames_bar
from col3d.errors import DataError, UserError
from col3d.geometry import Camera
from col3d.inference.cameras import camera_at, lens_of, outside_image, view_of
from col3d.inference.compiled import compile_network
from col3d.inference.options import PredictOptions
from col3d.inference.predicted_frame import Predicted
from col3d.inference.prediction_folder import PredictionFolder, check_room
from col3d.inference.predictor import Predictor, load_predictor
from col3d.layers.network import needs_rays
from col3d.registry.refusals import check_options
from col3d.runs.environment import check_accelerator, quiet
from col3d.runs.known_failures import as_user_errors
from col3d.signals import StopSignals, stoppable

READ_AHEAD = 4
"""Number of images that are decoded ahead, while the network is busy."""


def predict(given: Mapping[str, Any]) -> None:
    """Predict every image of a source and write the requested files.

    Args:
        given: the composed configuration as plain values; see `PredictOptions`.

    Raises:
        UserError: an option breaks a rule, or no image of the source can be read.
    """
    quiet()
    options = check_options(PredictOptions, given)
    check_accelerator(options.accelerator)
    with stoppable("the same command with overwrite=true predicts all of it") as stop:
        source = _source(options)
        check_room(Path(options.output), options, source)
        lens = _lens(options, source)
        _check_sides(lens, source)
        network = _network(options, lens)
        _print_validity(network, lens)
        with (
            as_user_errors("batch_size=1 takes least at a time; images can be made smaller first"),
            PredictionFolder(Path(options.output), options, network, source, lens) as folder,
        ):
            _run(network, source, lens, options, folder, stop)
        folder.report(stop.pending is not None)
    if folder.written == 0:
        raise UserError(
            f"input: no image of {options.input} could be predicted; the first: {folder.faults[0]}"
        )


def _source(options: PredictOptions) -> ImageSource:
    try:
        source = image_source(options.input)
    except DataError as error:
        raise UserError(str(error)) from None
    for note in source.notes:
        print(note, flush=True)
    return source


def _lens(options: PredictOptions, source: ImageSource) -> Camera | None:
    """Return the camera; a pinhole's numbers hold for the first image's size, and are scaled for others."""
    lens = lens_of(options.camera)
    if lens is None or lens.size_hw != (0, 0):
        return lens
    first = next((shot.image for shot in source if shot.image is not None), None)
    if first is None:
        raise UserError(f"input: no image of {options.input} can be read")
    return camera_at(lens, (first.shape[0], first.shape[1]))


def _check_sides(lens: Camera | None, source: ImageSource) -> None:
    """Refuse images of which none has the aspect ratio of the lens, before any is decoded."""
    if lens is None:
        return
    refused: DataError | None = None
    for size_hw in source.sizes():
        try:
            camera_at(lens, size_hw)
            return
        except DataError as error:
            refused = refused or error
    if refused is not None:
        raise UserError(str(refused))


def _network(options: PredictOptions, lens: Camera | None) -> Predictor:
    network = load_predictor(Path(options.checkpoint), options.published, options.max_depth, options.size)
    if needs_rays(network.network) and lens is None:
        raise UserError(
            "camera: this network's normals are relative to the viewing rays (model.normal_frame=ray); "
            "give the camera of the images, such as camera=c3vd"
        )
    network.place(options.accelerator)
    if options.compile:
        compile_network(network.network, trained=True)
    return network


def _print_validity(network: Predictor, lens: Camera | None) -> None:
    """Print whether depth is metric with this camera, before anything is predicted."""
    if lens is None:
        print("camera: none given; depth is relative and no millimetres are claimed", flush=True)
        return
    if outside := outside_image(lens):
        print(f"camera: {outside}", flush=True)
    if network.cameras and not network.knows(lens):
        print(
            f"camera: not the lens that {network.name} was trained with ({', '.join(network.trained_on)}); "
            "millimetres are those of a lens that the network has never seen",
            flush=True,
        )


def _run(
    network: Predictor,
    source: ImageSource,
    lens: Camera | None,
    options: PredictOptions,
    folder: PredictionFolder,
    stop: StopSignals,
) -> None:
    """Predict and write all images, or those before a stop signal."""
    stop.hold()
    with frames_bar("predict") as bar:
        task = bar.add_task("frames", total=source.count or None)
        for shots in batched(ahead(source, READ_AHEAD), options.batch_size):
            for shot, frame in _predicted(network, shots, lens, options):
                folder.skip(shot) if frame is None else folder.add(frame)
                bar.advance(task)
                if stop.pending is not None:
                    return


def batched(shots: Iterable[SourceImage], most: int) -> Iterator[list[SourceImage]]:
    """Group successive images of one size into batches, in order; a broken image is a batch of its own."""
    alike = itertools.groupby(shots, lambda shot: None if shot.image is None else shot.image.shape)
    for shape, group in alike:
        while batch := list(itertools.islice(group, 1 if shape is None else most)):
            yield batch


def _predicted(
    network: Predictor, shots: list[SourceImage], lens: Camera | None, options: PredictOptions
) -> Iterator[tuple[SourceImage, Predicted | None]]:
    """Yield each image with its prediction, or with None if it has a fault."""
    images = [shot.image for shot in shots if shot.image is not None]
    if not images:
        yield from ((shot, None) for shot in shots)
        return
    size_hw = (images[0].shape[0], images[0].shape[1])
    try:
        camera = None if lens is None else camera_at(lens, size_hw)
    except DataError as error:
        yield from (
            (SourceImage(shot.name, shot.number, None, f"{shot.name}: {error}"), None) for shot in shots
        )
        return
    start = time.perf_counter()
    batch = torch.stack([torch.from_numpy(np.array(image)).permute(2, 0, 1) for image in images])
    prediction = network.predict(batch, camera)
    depth = prediction["depth"][:, 0].cpu().numpy()
    normals = prediction["normals"].permute(0, 2, 3, 1).cpu().numpy() if "normals" in prediction else None
    seconds = (time.perf_counter() - start) / len(shots)
    view = view_of(options.camera, size_hw)
    mask = None if view is None else view[0].numpy()
    for i, shot in enumerate(shots):
        yield shot, Predicted(shot, depth[i], None if normals is None else normals[i], mask, camera, seconds)
