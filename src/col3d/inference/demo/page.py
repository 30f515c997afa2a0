"""The page and its events. The layout is in `layout`, the content of replies in `replies`."""

import math
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import gradio as gr

from col3d.inference.demo.answer import Answer, Picture, shown
from col3d.inference.demo.layout import answers, head, message_box, questions
from col3d.inference.demo.replies import PINHOLE, Question, Reply, reply, scores_table
from col3d.inference.demo.samples import Sample
from col3d.inference.predictor import Predictor

FORGET_SECONDS = 3600
"""Seconds after which uploads are deleted while the program runs."""
HIDDEN: dict[str, Any] = {"api_visibility": "private"}


def page(
    network: Predictor, camera: str, pinhole: Sequence[float], offered: Sequence[Sample], folder: Path
) -> gr.Blocks:
    """Build the page and connect its events.

    Args:
        network: the predictor.
        camera: initial choice, one of the values of `cameras()`.
        pinhole: initial fx, fy, cx, cy, or nothing.
        offered: example images.
        folder: folder for files that the page shows.
    """
    forget = (FORGET_SECONDS, FORGET_SECONDS)
    with gr.Blocks(title="col3d", analytics_enabled=False, delete_cache=forget) as blocks:
        head(network.name, network.trained_on)
        with gr.Row():
            with gr.Column(scale=2, min_width=300):
                fields = questions(camera, pinhole, offered)
            with gr.Column(scale=5):
                views = answers()
        _connect(network, fields, views, offered, folder)
    return blocks


def _connect(
    network: Predictor, fields: dict[str, Any], views: dict[str, Any], offered: Sequence[Sample], folder: Path
) -> None:
    inputs = [fields["file"], fields["truth"], fields["camera"], *fields["pinhole"]]
    outputs = list(views.values())

    def predict(*given: Any, progress: Any = gr.Progress()) -> dict[Any, Any]:  # noqa: B008 - as Gradio requires
        file, truth, camera, *pinhole = given
        response = reply(network, Question(file, truth, camera, tuple(pinhole)), folder, progress)
        return {views[name]: value for name, value in updates(response).items()}

    def chosen(event: gr.SelectData) -> list[str | None]:
        sample = offered[event.index]
        return [str(sample.image), None if sample.truth is None else str(sample.truth)]

    changes = [fields["truth"].upload, fields["truth"].clear, fields["camera"].input]
    changes += [event for number in fields["pinhole"] for event in (number.submit, number.blur)]
    gr.on(changes, predict, inputs, outputs, trigger_mode="always_last", **HIDDEN)
    changed = [fields["file"].upload, fields["file"].clear]
    another = gr.on(changed, lambda: None, None, fields["truth"], **HIDDEN)
    another.then(predict, inputs, outputs, **HIDDEN)  # a ground truth belongs to one image
    fields["camera"].input(
        lambda camera: gr.Row(visible=camera == PINHOLE), fields["camera"], fields["numbers"], **HIDDEN
    )
    if offered:
        files = [fields["file"], fields["truth"]]
        chosen_event = fields["offered"].select(chosen, None, files, show_progress="hidden", **HIDDEN)
        chosen_event.then(predict, inputs, outputs, **HIDDEN)
    moved = [views["low"].input, views["high"].input]
    sliders = [views["answer"], views["low"], views["high"]]
    gr.on(
        moved,
        recoloured,
        sliders,
        views["depth"],
        trigger_mode="always_last",
        show_progress="hidden",
        **HIDDEN,
    )


def recoloured(answer: Answer | None, low: float, high: float) -> Picture | None:
    """Draw the depth of an earlier answer in other colours."""
    return None if answer is None else answer.depth_picture(low, high)


def updates(response: Reply) -> dict[str, Any]:
    """Return the new values of the output components, by name."""
    values: dict[str, Any] = {
        "words": message_box(response.words, response.refused),
        "answer": response.answer,
        "pictures": gr.Column(visible=response.answer is not None),
        "video": gr.Video(response.video, visible=response.video is not None),
    }
    return values if response.answer is None else {**values, **_pictures(response.answer, response.cloud)}


def _pictures(answer: Answer, cloud: str | None) -> dict[str, Any]:
    low, high = answer.span
    step = 0.01 if answer.camera is None else 0.5
    most = step * math.ceil(float(answer.depth.max()) / step)
    low, high = (round(step * round(end / step), 2) for end in (low, high))
    normals, error = answer.normals_picture(), answer.error_picture()
    return {
        "image": shown(answer.image),
        "depth": answer.depth_picture(low, high),
        "low": gr.Slider(0, most, low, step=step, label=f"Colours of depth from, {answer.unit}"),
        "high": gr.Slider(0, most, high, step=step, label=f"to, {answer.unit}"),
        "normals": gr.Image(normals, visible=normals is not None),
        "cloud": gr.Model3D(cloud, visible=cloud is not None),
        "comparison": gr.Row(visible=error is not None),
        "error": error,
        "scores": scores_table(answer.scores()),
    }
