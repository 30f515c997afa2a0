"""The page in the browser: python app.py, then open http://127.0.0.1:7860."""

from typing import Any

from launch import launch


def run(given: dict[str, Any]) -> None:
    """Serve; imports wait until the options are composed, so that --help and --cfg answer at once."""
    from col3d.demo.serve import serve

    serve(given)


if __name__ == "__main__":
    launch("app", run)
