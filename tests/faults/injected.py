"""Every write, rename, fsync and read of every command fails once: `python -m tests.faults.injected`.

Of each command one small run is counted, then run again for every n with its n-th call failing. After each:
what was there before is there as it was; nothing looks finished that is not; an exit code of 0 stands for the
undisturbed result; and the same command, undisturbed, ends in that result.
"""

import argparse
import math
import shutil
import sys
import tempfile
import time
from collections import Counter
from collections.abc import Sequence
from contextlib import closing
from dataclasses import dataclass, field
from pathlib import Path

from tests.faults.injector import KINDS, Injector
from tests.faults.small_runs import RUNS, SmallRun, prepared_place
from tests.faults.trial import row

COLUMNS = ("command", "calls that failed once", "survived", "exit code 0", "an error in a line")


@dataclass
class Tally:
    """What came of the faults of one command."""

    calls: dict[str, int] = field(default_factory=dict)
    made: Counter[str] = field(default_factory=Counter)
    codes: Counter[int] = field(default_factory=Counter)
    broken: list[str] = field(default_factory=list)

    def cells(self, name: str) -> list[str]:
        """The row of the command."""
        made = ", ".join(f"{self.made[kind]} of {n} {kind}s" for kind, n in self.calls.items() if n)
        total = sum(self.made.values())
        survived = f"{total - len(self.broken)} of {total}"
        return [name, made, survived, str(self.codes[0]), str(self.codes[2])]


def main(arguments: Sequence[str] | None = None) -> int:
    """Run it; exit code 1 where a fault did harm."""
    parser = argparse.ArgumentParser("injected", description=__doc__)
    parser.add_argument("--only", nargs="*", default=[run.name for run in RUNS], metavar="COMMAND")
    parser.add_argument("--kinds", nargs="*", default=list(KINDS), choices=KINDS)
    parser.add_argument("--most", type=int, metavar="N", help="of each kind, N calls spread evenly over all")
    parser.add_argument("--seconds", type=float, help="of each kind of a command, as many as fit, spread")
    parser.add_argument("--stays", action="store_true", help="all calls of the kind fail from the n-th on")
    options = parser.parse_args(arguments)
    with tempfile.TemporaryDirectory(prefix="injected-") as temporary:
        place = Path(temporary)
        with closing(Injector(place)) as injector:
            start = prepared_place(place / "trial", injector).rename(place / "start")
            tallies = {}
            print(row(COLUMNS), row(["---"] * len(COLUMNS)), sep="\n", flush=True)
            for run in (run for run in RUNS if run.name in options.only):
                began = time.monotonic()
                tallies[run.name] = tried(run, start, place, injector, options)
                print(row(tallies[run.name].cells(run.name)), flush=True)
                for line in tallies[run.name].broken:
                    print(f"  {line}", flush=True)
                print(f"{run.name}: {time.monotonic() - began:.0f} s", file=sys.stderr, flush=True)
    return int(any(tally.broken for tally in tallies.values()))


def tried(run: SmallRun, start: Path, place: Path, injector: Injector, options: argparse.Namespace) -> Tally:
    """All faults of one command."""
    whole, tally = place / "trial", Tally()
    copied(start, whole)
    run.make_ready(whole)
    code, calls, said = injector.run(run.name, run.given(whole), whole)
    if code:
        raise SystemExit(f"{run.name} failed without a fault: {said}")
    expected, tally.calls = run.result(whole), {kind: calls[kind] for kind in options.kinds}
    for kind in options.kinds:
        end = math.inf if options.seconds is None else time.monotonic() + options.seconds
        for n in in_spread_order(spread(calls[kind], options.most)):
            if time.monotonic() > end:
                break
            tally.made[kind] += 1
            fault = one(run, start, whole, injector, kind, n, options.stays, expected, tally)
            if fault:
                tally.broken.append(f"{kind} {n}: {fault}")
                print(f"{run.name}: {tally.broken[-1]}", file=sys.stderr, flush=True)
    return tally


def spread(calls: int, most: int | None) -> list[int]:
    """Which calls fail: all, or so many, the first and the last among them."""
    if most is None or calls <= most:
        return list(range(1, calls + 1))
    if most == 1:
        return [(calls + 1) // 2]
    return sorted({1 + round(i * (calls - 1) / (most - 1)) for i in range(most)})


def in_spread_order(numbers: Sequence[int]) -> list[int]:
    """The same, so that the first few of them are spread over all (van der Corput's order)."""
    places = sorted(range(len(numbers)), key=lambda place: int(f"{place:032b}"[::-1], 2))
    return [numbers[place] for place in places]


def one(
    run: SmallRun,
    start: Path,
    whole: Path,
    injector: Injector,
    kind: str,
    n: int,
    stays: bool,
    expected: dict[str, str],
    tally: Tally,
) -> str:
    """What is wrong after one fault, or nothing."""
    copied(start, whole)
    run.make_ready(whole)
    before = run.others(whole)
    code, _, said = injector.run(run.name, run.given(whole), whole, kind, n, stays)
    tally.codes[code] += 1
    if code not in (0, 2):
        return f"exit code {code}: {said.strip().splitlines()[-1] if said.strip() else 'nothing said'}"
    if run.others(whole) != before:
        return "what was there before has changed"
    differing = _differing(run.result(whole), expected)
    if differing and (run.looks_finished(whole) or code == 0) and not (code == 0 and "note:" in said):
        return f"looks finished (exit code {code}) and differs in {differing}"
    if code == 0 and not differing:
        return ""
    return _afterwards(run, whole, injector, before, expected)


def _afterwards(
    run: SmallRun, whole: Path, injector: Injector, before: dict[str, str], expected: dict[str, str]
) -> str:
    """What is wrong after the same command has run again, or nothing."""
    code, _, said = injector.run(run.name, run.given(whole), whole)
    if code:
        return f"afterwards exit code {code}: {said.strip().splitlines()[-1]}"
    if differing := _differing(run.result(whole), expected):
        return f"afterwards differs in {differing}"
    if run.others(whole) != before:
        return "afterwards what was there before has changed"
    left = [path.name for path in whole.rglob("*.partial*")]
    return f"left behind: {', '.join(left)}" if left else ""


def _differing(found: dict[str, str], expected: dict[str, str]) -> str:
    names = sorted(n for n in found.keys() | expected.keys() if found.get(n) != expected.get(n))
    return ", ".join(names[:5])


def copied(start: Path, whole: Path) -> None:
    shutil.rmtree(whole, ignore_errors=True)
    shutil.copytree(start, whole)


if __name__ == "__main__":
    sys.exit(main())
