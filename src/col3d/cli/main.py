"""Entry point `col3d PROGRAM [OPTION=VALUE ...]`: the list of programs, and their help."""

import os
import sys
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from importlib import import_module

from col3d.errors import OptionError
from col3d.nearest_names import nearest_name
from col3d.signals import startup as early

EXIT_CODE = 2
WAITING = ("OMP_WAIT_POLICY", "PASSIVE")
"""Let waiting threads of torch sleep: if they spin, programs that share cores slow each other down."""
HELP = ("--help", "-h", "help")


@dataclass(frozen=True)
class Program:
    """A program, which the first word after `col3d` names.

    Attributes:
        summary: its line in the help.
        place: `module:function` that runs it with the words that follow, imported when it is called.
    """

    summary: str
    place: str

    def __call__(self, name: str, words: list[str]) -> int | None:
        """Run the program; return its exit code, or None for 0."""
        module, _, function = self.place.partition(":")
        run: Callable[[str, list[str]], int | None] = getattr(import_module(module), function)
        return run(name, words)


OPTIONS = "col3d.cli.programs:run"
PROGRAMS = {
    "train": Program("train a network and score its best checkpoint", OPTIONS),
    "evaluate": Program("score a checkpoint on a part of a split", OPTIONS),
    "predict": Program("depth and normals of images, folders and videos", OPTIONS),
    "fuse": Program("one surface from the depth of a video's frames", OPTIONS),
    "export": Program("write a network as ONNX, a torch program, or in half precision", OPTIONS),
    "demo": Program("a page in the browser, on this machine alone", OPTIONS),
    "download": Program("fetch C3VD from its server", OPTIONS),
    "prepare": Program("render a phantom, or decode a data set once", OPTIONS),
    "verify": Program("check a whole data set without training", OPTIONS),
    "benchmark": Program("run the paper's experiments and report them", OPTIONS),
    "report": Program("tables, figures and a page of all runs below a folder", "col3d.cli.listing:report"),
    "list": Program("names of models, losses and other parts", "col3d.cli.listing:list_parts"),
    "describe": Program("the options of one part: describe model bts", "col3d.cli.listing:describe_part"),
    "completion": Program("what a shell completes words by", "col3d.cli.completion:run"),
}
USAGE = """\
usage: col3d PROGRAM [OPTION=VALUE ...]

{programs}

col3d PROGRAM --help lists its options. A training on the rendered colon:

  col3d train model=col3d_mtl loss.lambdas=[0.5,0.3,0.2]
  col3d train -m model=bts,col3d_mtl seed=0,1
  col3d evaluate checkpoint=runs/default/checkpoints/best.ckpt
"""


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the program that the first word names with the words that follow.

    Args:
        arguments: the command line; the one of this process when absent.

    Returns:
        The exit code: 2 for bad input, after one line for each fault.
    """
    early.listen()  # before imports that take seconds
    os.environ.setdefault(*WAITING)  # before torch is loaded, which reads it then
    name, *words = [*(sys.argv[1:] if arguments is None else arguments)] or ["--help"]
    if name in HELP:
        print(usage())
        return 0
    try:
        if name not in PROGRAMS:
            near = nearest_name(name, PROGRAMS)
            raise OptionError(f"{name!r} is no program of col3d{near}; there are {', '.join(PROGRAMS)}")
        code = PROGRAMS[name](name, words) or 0
        sys.stdout.flush()
        return code
    except BrokenPipeError:  # the reader closed the pipe: `col3d train --help | head`
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return 0
    except OptionError as error:
        print(f"error: {error}", file=sys.stderr)
        return EXIT_CODE


def usage() -> str:
    """Return the help of all programs, on one screen."""
    width = max(map(len, PROGRAMS))
    return USAGE.format(
        programs="\n".join(f"  {name:{width}}  {program.summary}" for name, program in PROGRAMS.items())
    ).rstrip()
