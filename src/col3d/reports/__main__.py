"""`col3d report RUNS OUT`: tables, figures and a page of all finished runs below a folder."""

import argparse
import sys
from pathlib import Path

from col3d.errors import UserError
from col3d.io.ownership import Owned
from col3d.reports.experiments import experiments_of
from col3d.reports.page import Picture, names_of, write_report
from col3d.reports.runs import Found, read_runs

EXIT_CODE = 2


def main(arguments: list[str] | None = None) -> int:
    """Run from the command line; bad input ends in one line and exit code 2."""
    given = _parser().parse_args(arguments)
    try:
        written = report(given.runs, given.out, given.protocol, given.truth)
    except (UserError, OSError) as error:
        print(f"error: {error}", file=sys.stderr)
        return EXIT_CODE
    print("wrote", *written, sep="\n  ")
    return 0


def report(runs: Path, out: Path, protocol: str | None, truth: Path | None) -> list[Path]:
    """Read runs and write their report.

    Raises:
        UserError: there is nothing to report, or OUT holds files of others under the names of a report's.
    """
    if not runs.is_dir():
        raise UserError(f"RUNS: {runs} is no folder")
    if out.exists() and not out.is_dir():
        raise UserError(f"OUT: {out} is a file; a folder is needed")
    collected = read_runs(runs)
    for line in collected.left_out:
        print(f"note: left out: {line}")
    if not collected.runs:
        raise UserError(
            f"RUNS: no finished run in {runs}: a run has config.yaml, summary.json, per_frame.csv"
        )
    collected = _of_protocol(collected, protocol)
    experiments = experiments_of(collected)
    owned = Owned(out, "report", "OUT")
    names = names_of(experiments)
    owned.claim(*names, *_names_of_pictures())
    pictures, not_drawn = _pictures(collected, out / "figures", truth or _beside(runs))
    written = write_report(out, collected, experiments, pictures, not_drawn, str(runs))
    owned.remove(keep={path.relative_to(out).as_posix() for path in written})
    return written


def _beside(runs: Path) -> Path | None:
    """Folder of the frames that col3d benchmark keeps beside its runs; None where it is absent."""
    return runs / "truth" if (runs / "truth").is_dir() else None


def _of_protocol(collected: Found, protocol: str | None) -> Found:
    """The runs that are scored under a protocol; the others are listed as left out."""
    if protocol is None:
        return collected
    known = sorted({str(run.summary["protocol"]) for run in collected.runs})
    if protocol not in known:
        raise UserError(f"--protocol: no run is scored under {protocol!r}; there are {', '.join(known)}")
    kept = tuple(run for run in collected.runs if run.summary["protocol"] == protocol)
    others = tuple(
        f"{run.name}: scored under protocol {run.summary['protocol']}, not {protocol}"
        for run in collected.runs
        if run.summary["protocol"] != protocol
    )
    return Found(kept, (*collected.left_out, *others))


def _pictures(collected: Found, folder: Path, truth: Path | None) -> tuple[list[Picture], tuple[str, ...]]:
    """Draw figures of the runs; returns them, and the reasons why others are not drawn."""
    from col3d.reports.figures import draw

    drawn = draw(collected, folder, truth)
    return [Picture(figure.title, figure.caption, figure.path) for figure in drawn.figures], drawn.left_out


def _names_of_pictures() -> list[str]:
    from col3d.reports.figures import DRAW

    return [f"figures/{name}.png" for name in DRAW]


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(prog="col3d report", description=__doc__)
    parser.add_argument("runs", type=Path, metavar="RUNS", help="folder that holds runs, at any depth")
    parser.add_argument("out", type=Path, metavar="OUT", help="folder that the report is written to")
    parser.add_argument("--protocol", metavar="NAME", help="take runs scored under this protocol alone")
    parser.add_argument(
        "--truth",
        type=Path,
        metavar="FOLDER",
        help="frames of the data set, for figures that show them; RUNS/truth where it is there",
    )
    return parser


if __name__ == "__main__":
    sys.exit(main())
