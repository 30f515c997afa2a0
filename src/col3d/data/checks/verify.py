"""Check a whole data set without training: options -> chunks of frames -> findings."""

import sys
import time
from collections.abc import Iterable, Mapping, Sequence
from itertools import chain
from pathlib import Path
from typing import Any

from col3d.data.build import frame_set, other_folder_names
from col3d.data.cache.choice import remembered
from col3d.data.checks import (
    ExpectedVideo,
    Finding,
    FrameReport,
    Plan,
    WholeReport,
    check,
    conclude_lens,
    duplicates,
    frames_to_show,
    plan_video,
)
from col3d.data.checks.facts import facts_of, pictures_of
from col3d.data.checks.options import VerifyOptions
from col3d.data.checks.stores import check_store, stores_beside
from col3d.data.checks.video_summary import summarise_video
from col3d.data.datasets.frame_set import FrameSet
from col3d.data.datasets.release import RELEASES
from col3d.data.datasets.videos import catalogue, frames_of
from col3d.data.options import SourceOptions
from col3d.data.processes import in_processes
from col3d.data.rendered import is_rendered
from col3d.data.splits import expand, selection_of_any_video
from col3d.errors import DataError, UserError
from col3d.io.json_files import write_json
from col3d.io.ownership import Owned
from col3d.io.run_files import read_plain
from col3d.phantom.options import PhantomOptions
from col3d.phantom.write import read_manifest
from col3d.registry import DATASETS
from col3d.registry.refusals import check_options
from col3d.reports.verification import Picture, print_verification, write_page
from col3d.signals import StopSignals, stoppable

FAULTY = 1
FACTS, PAGE = "verify.json", "verify.html"


def verify(given: Mapping[str, Any]) -> None:
    """Check every video of a data set, write verify.json and verify.html, and exit with 1 after a fault.

    Raises:
        UserError: an option breaks a rule, or there is nothing to check.
    """
    options = check_options(VerifyOptions, given)
    with stoppable(f"the same command begins anew; nothing new is in {options.output}") as stop:
        faults = _verify(options, stop)
    if faults:
        sys.exit(FAULTY)


def _verify(options: VerifyOptions, stop: StopSignals) -> int:
    """Check, write and print; returns the number of faults."""
    source, began = options.data, time.monotonic()
    owned = _checked_room(Path(options.output))
    frames = frame_set(source, options.phantom, [])
    _check_phantom(source, options.phantom, frames.folders)
    findings = _missing(source, frames.folders)
    plans, skipped = _plans(source, frames, options.fast)
    reports, wholes = _reports(frames, plans, options.workers)
    videos = {
        name: summarise_video(frames, plan, reports[name], _expected(source, options.phantom, name))
        for name, plan in plans.items()
    }
    for name, whole in wholes.items():
        conclude_lens(videos[name], whole.lens)
        videos[name].findings += whole.findings
    every = list(chain.from_iterable(reports.values()))
    duplicates(videos, plans, every)
    of_videos = chain.from_iterable(video.findings for video in videos.values())
    findings = [*findings, *skipped, *_stores(options), *of_videos]
    facts = facts_of(options, videos, every, findings)
    facts["seconds"] = round(time.monotonic() - began, 2)
    pictures = pictures_of(frames, frames_to_show(plans, reports, findings))
    stop.hold()  # until all files are written
    _write(owned, facts, pictures)
    stop.pending = None  # all files are written, so that a pending signal has no effect
    return sum(finding.fault for finding in findings)


def _checked_room(folder: Path) -> Owned:
    """The output folder, unless foreign files would be replaced in it."""
    owned = Owned(folder, "verification", "output")
    if folder.exists() and not folder.is_dir():
        raise UserError(f"output: {folder} is a file; name a folder")
    if {"data", "findings", "videos"} <= read_plain(
        folder / FACTS
    ).keys():  # a verification without a list of its files
        owned.adopt(FACTS, PAGE)
    owned.check([FACTS, PAGE])
    return owned


def _missing(source: SourceOptions, present: Iterable[str]) -> list[Finding]:
    """Findings on videos of the split that do not exist."""
    present = list(present)
    missing = [video for video in _named(source, present) if video not in present]
    hint = "copy it there, or set data.allow_missing=true"
    if source.allow_missing:
        text = f"data.root={source.root}: left out, because data.allow_missing=true: {', '.join(missing)}"
        return [Finding("missing", text, fault=False)] if missing else []
    return [
        Finding(
            "missing",
            f"{Path(source.root) / video}: no such video of split {source.split.name}; {hint}",
            video,
        )
        for video in missing
    ]


def _named(source: SourceOptions, present: Sequence[str]) -> list[str]:
    """Videos of the split, each once."""
    parts = [*source.split.train, *source.split.val, *source.split.test]
    entries = expand(parts, present)
    return list(dict.fromkeys(selection_of_any_video(entry, present).video for entry in entries))


def _plans(source: SourceOptions, frames: FrameSet, fast: bool) -> tuple[dict[str, Plan], list[Finding]]:
    """Plans of the videos, and notes on folders that hold no frames or videos of another data set."""
    if names := other_folder_names(frames):
        print(names, flush=True)
    foreign = [video for video in frames.folders if _is_foreign(source, video)]
    folders = {video: folder for video, folder in frames.folders.items() if video not in foreign}
    plans = {video: plan_video(frames, video, folder, fast) for video, folder in folders.items()}
    if not any(plan.frames for plan in plans.values()):
        raise UserError(f"data.root={source.root}: {frames.without_frames()}")
    named = _named(source, list(folders))
    empty = [video for video, plan in plans.items() if not (plan.frames or plan.findings or video in named)]
    notes = [
        Finding("count", f"{folders[v]}: holds no frames, not looked into", v, fault=False) for v in empty
    ]
    notes += [
        Finding("count", f"{frames.folders[v]}: not looked into: {frames.refusal(v)}", v, fault=False)
        for v in foreign
    ]
    return {video: plan for video, plan in plans.items() if video not in empty}, notes


def _is_foreign(source: SourceOptions, video: str) -> bool:
    """Whether a video belongs to the other one of the two data sets of C3VD."""
    row = catalogue().get(video)
    return DATASETS[source.name].facts["table"] and row is not None and row.data != source.name


def _reports(
    frames: FrameSet, plans: Mapping[str, Plan], workers: int | None
) -> tuple[dict[str, list[FrameReport]], dict[str, WholeReport]]:
    """Check every frame of every video, and each video as a whole."""
    parts = [part for plan in plans.values() for part in (*plan.chunks, plan)]
    total = sum(len(plan.frames) for plan in plans.values())
    reports: dict[str, list[FrameReport]] = {video: [] for video in plans}
    wholes: dict[str, WholeReport] = {}
    results = in_processes(check, [(frames, part) for part in parts], "verify", total, workers)
    for part, result in zip(parts, results, strict=True):
        if isinstance(part, Plan):
            wholes[part.video] = result
        for report in [] if isinstance(part, Plan) else result:
            reports[report.video].append(report)
    return reports, wholes


def _expected(source: SourceOptions, phantom: PhantomOptions, video: str) -> ExpectedVideo:
    """Expected properties of a video: from the table, or from the options of a phantom."""
    row = catalogue().get(video)
    listed = row is not None and row.data == source.name
    counts: dict[str, int] = {}
    if is_rendered(source):
        counts = dict.fromkeys(RELEASES, phantom.frames_per_video)
    elif listed:
        counts = {release: frames_of(video, release) or 0 for release in RELEASES}
    release = source.own.get("release", "auto") if source.normals == "stored" else "auto"
    has_poses = is_rendered(source) or listed
    return ExpectedVideo(counts, exactly=not source.allow_missing, release=release, poses=has_poses)


def _check_phantom(source: SourceOptions, phantom: PhantomOptions, folders: Mapping[str, Path]) -> None:
    """Refuse options that a phantom was not rendered with: every file would be reported as wrong."""
    for folder in folders.values() if is_rendered(source) else ():
        made = (read_manifest(folder) or {}).get("settings", {})
        size, count = (
            made.get("size_hw", phantom.size),
            made.get("frames_per_video", phantom.frames_per_video),
        )
        if (size, count) != (phantom.size, phantom.frames_per_video):
            raise DataError(
                f"data.root={source.root}: {folder.name} was rendered otherwise; give "
                f"phantom.size=[{','.join(map(str, size))}] phantom.frames_per_video={count}"
            )


def _stores(options: VerifyOptions) -> list[Finding]:
    """Findings on the named store, or on those that a training would find."""
    source, root = options.data, Path(options.data.root)
    if source.store == "none":
        return []
    if source.store != "auto":
        return check_store(Path(source.store), options.fast)
    places = dict.fromkeys([*stores_beside(root), *remembered(root)])
    return [finding for place in places if place.is_dir() for finding in check_store(place, options.fast)]


def _write(owned: Owned, facts: Mapping[str, Any], pictures: Sequence[Picture]) -> None:
    owned.claim(FACTS, PAGE)
    write_page(owned.folder / PAGE, facts, pictures)
    write_json(owned.folder / FACTS, facts)
    print_verification(facts)
    print(f"written: {owned.folder / PAGE}, {owned.folder / FACTS}", flush=True)
