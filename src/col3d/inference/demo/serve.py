"""`col3d demo`: serve the page on this machine, without any access to the network."""

import importlib.util
import logging
import os
import signal
import sys
import tempfile
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from col3d.errors import UserError
from col3d.inference.cameras import lenses
from col3d.inference.demo.checkpoint import newest_checkpoint
from col3d.inference.options import DemoOptions
from col3d.inference.predictor import load_predictor
from col3d.registry.refusals import check_options
from col3d.runs.environment import quiet
from col3d.signals import startup as early

HOST = "127.0.0.1"
TERMINATED = 143
RUNS = Path("runs")
MOST_UPLOAD = "200mb"
"""Size above which an upload is aborted; the page refuses smaller ones by a message."""
SILENT = {"GRADIO_ANALYTICS_ENABLED": "False", "HF_HUB_DISABLE_TELEMETRY": "1", "HF_HUB_OFFLINE": "1"}


def serve(given: Mapping[str, Any]) -> None:
    """Load a network and serve the page until Ctrl-C.

    Args:
        given: the composed configuration as plain values; see `DemoOptions`.

    Raises:
        UserError: an option or the checkpoint breaks a rule, or the port is taken.
    """
    quiet()
    options = check_options(DemoOptions, given)
    if importlib.util.find_spec("gradio") is None:
        raise UserError("app: needs pip install -e '.[demo]'")
    checkpoint = newest_checkpoint(RUNS) if options.checkpoint is None else Path(options.checkpoint)
    if isinstance(options.camera, str) and options.camera not in lenses():
        known = ", ".join(lenses())
        raise UserError(f"camera: expected {known}, [fx,fy,cx,cy] or none, got {options.camera!r}")
    network = load_predictor(checkpoint, options.published, options.max_depth, options.size)
    network.place("auto")
    os.environ.update(SILENT)  # before Gradio is imported
    from col3d.inference.demo.layout import STYLE
    from col3d.inference.demo.page import page
    from col3d.inference.demo.replies import PINHOLE, UNKNOWN
    from col3d.inference.demo.samples import samples

    pinhole = options.camera if isinstance(options.camera, list) else []
    camera = PINHOLE if pinhole else str(options.camera or UNKNOWN)
    early.over()
    for number in (signal.SIGTERM, signal.SIGHUP):
        signal.signal(number, lambda *_: sys.exit(TERMINATED))
    print(f"{network.name} of {checkpoint}: http://{HOST}:{options.port} (Ctrl-C ends it)", flush=True)
    with tempfile.TemporaryDirectory(prefix="col3d-") as folder:
        uploads, examples = Path(folder) / "uploads", Path(folder) / "examples"
        uploads.mkdir()
        examples.mkdir()
        os.environ["GRADIO_TEMP_DIR"] = str(uploads)  # deleted when the program ends
        offered = [] if options.samples is None else samples(Path(options.samples), examples)
        _launch(page(network, camera, pinhole, offered, uploads), options, STYLE)


def _launch(blocks: Any, options: DemoOptions, style: str) -> None:
    import gradio as gr
    from starlette.middleware import Middleware

    from col3d.inference.demo.guard import Guard

    logging.getLogger("httpx").setLevel(logging.WARNING)  # httpx logs each request to the page's own address
    try:
        blocks.launch(
            server_name=HOST,
            server_port=options.port,
            share=False,
            quiet=True,
            ssr_mode=False,
            max_file_size=MOST_UPLOAD,
            app_kwargs={"middleware": [Middleware(Guard)]},
            footer_links=[],
            enable_monitoring=False,
            theme=gr.themes.Default(font=["system-ui"], font_mono=["monospace"]),
            css=style,
        )
    except OSError as error:
        if "port" in str(error):
            raise UserError(f"port: {options.port} is taken; give port=...") from None
        raise
