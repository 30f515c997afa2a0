"""Layout of the page: its components and style."""

from collections.abc import Sequence
from typing import Any

import gradio as gr

from col3d.inference.demo.replies import NOTHING_YET, PINHOLE, cameras
from col3d.inference.demo.samples import Sample

HEAD = """# Depth and surface normals in colonoscopy
Give an image or a short video of a colonoscopy, and look at depth, normals and points as
{name} sees them{data}."""
NOTICE = (
    '<div class="notice"><b>Research software, no medical device.</b> Not for diagnosis, treatment or any '
    "other clinical use. Files stay on this machine and are deleted when the program ends.</div>"
)
STYLE = """
.gradio-container { max-width: 1440px !important; margin: 0 auto; }
.html-container { padding: 0 !important; }
.notice, .said, .refused { display: block; padding: 8px 12px; border-left: 4px solid; }
.notice { border-color: #d97706; background: rgba(217, 119, 6, 0.12); }
.said { border-color: #0f766e; background: rgba(15, 118, 110, 0.10); }
.refused { border-color: #b91c1c; background: rgba(185, 28, 28, 0.12); font-weight: 600; }
#scores td, #scores th { padding: 4px 12px; text-align: left; }
footer { display: none !important; }
"""


def head(name: str, trained_on: Sequence[str]) -> None:
    """Add the heading, a description and the medical notice."""
    data = f", trained on {' and '.join(trained_on)}" if trained_on else ""
    gr.Markdown(HEAD.format(name=name, data=data))
    gr.HTML(NOTICE)


def questions(camera: str, pinhole: Sequence[float], offered: Sequence[Sample]) -> dict[str, Any]:
    """Add the input components, and return them by name."""
    components: dict[str, Any] = {"file": gr.File(label="Image or video", height=140, elem_id="file")}
    if offered:
        components["offered"] = gr.Gallery(
            [(str(sample.image), sample.caption) for sample in offered],
            label="Examples, of a phantom",
            columns=2,
            height=345,
            allow_preview=False,
            interactive=False,
            buttons=[],
            elem_id="examples",
        )
    components["camera"] = gr.Radio(list(cameras().items()), value=camera, label="Camera", elem_id="camera")
    with gr.Row(visible=camera == PINHOLE) as components["numbers"]:
        given = [*pinhole, None, None, None, None][:4]
        components["pinhole"] = [
            gr.Number(value, label=f"{name}, pixels", min_width=120)
            for name, value in zip(("fx", "fy", "cx", "cy"), given, strict=True)
        ]
    components["truth"] = gr.File(label="True depth, if there is one", height=140, elem_id="truth")
    return components


def answers() -> dict[str, Any]:
    """Add the output components, and return them by name."""
    components: dict[str, Any] = {
        "words": gr.HTML(message_box(NOTHING_YET), elem_id="words"),
        "answer": gr.State(),
    }
    with gr.Column(visible=False, elem_id="pictures") as components["pictures"]:
        with gr.Row():
            components["image"] = _picture("Image", "image")
            components["depth"] = _picture("Depth", "depth")
        with gr.Row():
            components["low"] = gr.Slider(0, 100, 0, label="Colours of depth from", buttons=[], elem_id="low")
            components["high"] = gr.Slider(0, 100, 100, label="to", buttons=[], elem_id="high")
        with gr.Row():
            with gr.Column():
                components["normals"] = _picture("Normals: red right, green up, blue towards us", "normals")
            with gr.Column():
                components["cloud"] = gr.Model3D(
                    label="Points: drag to turn, scroll to zoom", height=380, elem_id="cloud", buttons=[]
                )
        with gr.Row(visible=False) as components["comparison"]:
            with gr.Column():
                components["error"] = _picture("Absolute error", "error")
            with gr.Column():
                components["scores"] = gr.HTML(elem_id="scores")
    components["video"] = gr.Video(
        label="Result", show_label=False, visible=False, autoplay=True, loop=True, elem_id="video"
    )
    return components


def message_box(words: str, refused: bool = False) -> str:
    """Format a message as a box, whose style shows whether the request was refused."""
    return f"<span class='{'refused' if refused else 'said'}'>{words}</span>"


def _picture(label: str, name: str) -> Any:
    buttons: Any = []
    return gr.Image(label=label, format="png", interactive=False, elem_id=name, buttons=buttons)
