"""The page: what calls what. Where things stand is in `layout`, what they show in `replies`."""

import math
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import gradio as gr

from col3d.inference.demo.answer import Answer, Picture, shown
from col3d.inference.demo.layout import answers, head, questions, said
from col3d.inference.demo.replies import PINHOLE, Question, Reply, reply, scores_table
from col3d.inference.demo.samples import Sample
from col3d.inference.predictor import Predictor

FORGET_SECONDS = 3600
"""After which uploads are deleted while the program goes on."""
HIDDEN: dict[str, Any] = {"api_visibility": "private"}


def page(
    network: Predictor, camera: str, pinhole: Sequence[float], offered: Sequence[Sample], folder: Path
) -> gr.Blocks:
    """Lay it out and connect it.

    Args:
        network: that predicts.
        camera: what the page begins with, of the values of `cameras()`.
        pinhole: fx, fy, cx, cy to begin with, or nothing.
        offered: images to try.
        folder: for files that the page shows.
    """
    forget = (FORGET_SECONDS, FORGET_SECONDS)
    with gr.Blocks(title="col3d", analytics_enabled=False, delete_cache=forget) as blocks:
        head(network.name, network.trained_on)
        with gr.Row():
            with gr.Column(scale=2, min_width=300):
                asked = questions(camera, pinhole, offered)
            with gr.Column(scale=5):
                shown = answers()
        _connect(network, asked, shown, offered, folder)
    return blocks


def _connect(
    network: Predictor, asked: dict[str, Any], shown: dict[str, Any], offered: Sequence[Sample], folder: Path
) -> None:
    inputs = [asked["file"], asked["truth"], asked["camera"], *asked["pinhole"]]
    outputs = list(shown.values())

    def predict(*given: Any, progress: Any = gr.Progress()) -> dict[Any, Any]:  # noqa: B008 - as Gradio wants it
        file, truth, camera, *pinhole = given
        found = reply(network, Question(file, truth, camera, tuple(pinhole)), folder, progress)
        return {shown[name]: value for name, value in updates(found).items()}

    def chosen(event: gr.SelectData) -> list[str | None]:
        sample = offered[event.index]
        return [str(sample.image), None if sample.truth is None else str(sample.truth)]

    changes = [asked["truth"].upload, asked["truth"].clear, asked["camera"].input]
    changes += [event for number in asked["pinhole"] for event in (number.submit, number.blur)]
    gr.on(changes, predict, inputs, outputs, trigger_mode="always_last", **HIDDEN)
    another = gr.on([asked["file"].upload, asked["file"].clear], lambda: None, None, asked["truth"], **HIDDEN)
    another.then(predict, inputs, outputs, **HIDDEN)  # a truth is of one image
    asked["camera"].input(
        lambda camera: gr.Row(visible=camera == PINHOLE), asked["camera"], asked["numbers"], **HIDDEN
    )
    if offered:
        files = [asked["file"], asked["truth"]]
        chosen_event = asked["offered"].select(chosen, None, files, show_progress="hidden", **HIDDEN)
        chosen_event.then(predict, inputs, outputs, **HIDDEN)
    moved = [shown["low"].input, shown["high"].input]
    sliders = [shown["answer"], shown["low"], shown["high"]]
    gr.on(
        moved,
        recoloured,
        sliders,
        shown["depth"],
        trigger_mode="always_last",
        show_progress="hidden",
        **HIDDEN,
    )


def recoloured(answer: Answer | None, low: float, high: float) -> Picture | None:
    """Depth in other colours, of what was predicted before."""
    return None if answer is None else answer.depth_picture(low, high)


def updates(found: Reply) -> dict[str, Any]:
    """What each component of the answers becomes, by name."""
    shown: dict[str, Any] = {
        "words": said(found.words, found.refused),
        "answer": found.answer,
        "pictures": gr.Column(visible=found.answer is not None),
        "video": gr.Video(found.video, visible=found.video is not None),
    }
    return shown if found.answer is None else {**shown, **_pictures(found.answer, found.cloud)}


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
