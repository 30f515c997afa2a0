"""Figures: drawn from what is there, named where they cannot be, and true to the numbers."""

import json
import shutil
from collections.abc import Callable
from pathlib import Path

import cv2
import numpy as np
import pytest
from fake_runs import VIDEOS, change_summary, write_paper, write_run

from col3d.io.predictions import PredictionWriter, StoredPredictions
from col3d.registry.metric_specs import OURS
from col3d.reports.figures import (
    DRAW,
    choice,
    draw,
    draw_all,
    error_against,
    lambda_study,
    per_video,
    training_curves,
)
from col3d.reports.figures.bins import quartiles
from col3d.reports.figures.figure import LARGEST_FILE, blank, save
from col3d.reports.figures.figure_data import FigureData, figure_data_of
from col3d.reports.figures.maps import angle_between, read_guess, read_truth
from col3d.reports.figures.plots import axis_label
from col3d.reports.figures.style import PALETTE, Look, Style, ball, styles_of
from col3d.reports.per_frame import read_per_frame, write_per_frame
from col3d.reports.runs import Found, Run, read_runs

FRAMES, SIZE = 3, (12, 16)
NEED_TRUTH = [
    "data_sheet",
    "qualitative",
    "qualitative_normals",
    "per_segment_samples",
    "error_against",
    "ablation_errors",
]


def unit(random: np.random.Generator) -> np.ndarray:
    vectors = random.standard_normal((*SIZE, 3)).astype(np.float32)
    return vectors / np.linalg.norm(vectors, axis=-1, keepdims=True)


def keep(folder: Path, seed: int, normals: bool, images: bool = False, **facts: object) -> None:
    """Write predictions, or with images the truth: the first row of its pixels is not known."""
    random = np.random.default_rng(seed)
    writer = PredictionWriter(folder, {"max_depth": 100.0, **facts})
    for video in VIDEOS:
        for number in range(FRAMES):
            depth = random.uniform(5, 90, SIZE).astype(np.float32)
            if images:
                depth[0] = 0
            directions = unit(random) if normals else None
            writer.add(video, number, depth, directions, random.random((*SIZE, 3)) if images else None)
    writer.finish()


@pytest.fixture(scope="module")
def paper(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Runs of every kind with predictions and metrics by epoch, and their truth."""
    root = tmp_path_factory.mktemp("paper")
    write_paper(root / "runs", seeds=(0,))
    for run in read_runs(root / "runs").runs:
        shutil.rmtree(run.folder)
        lambdas = run.options["loss"]["lambdas"]
        changes = {"loss__lambdas": lambdas, "loss__terms": run.options["loss"]["terms"]}
        write_run(
            run.folder, str(run.summary["model"]), frames=FRAMES, worse=1 + len(run.name) / 50, **changes
        )
        predicts = run.options["model"]["normals"] == "unc"
        keep(run.folder / "predictions_test", len(run.name), predicts)
        (run.folder / "metrics.csv").write_text(
            "epoch,step,train/loss,val/abs_rel,val/angle_mean,val/loss\n"
            ",0,,,,\n0,5,,0.5,30.0,3.0\n0,5,4.0,,,\n1,9,,0.4,20.0,2.5\n1,9,2.0,,,\n,0,,,,\n"
        )
    off_axis = np.hypot(*np.meshgrid(np.linspace(-70, 70, SIZE[1]), np.linspace(-50, 50, SIZE[0])))
    keep(root / "truth", 100, True, images=True, off_axis=off_axis.tolist())
    return root


@pytest.fixture(scope="module")
def material(paper: Path) -> FigureData:
    return figure_data_of(read_runs(paper / "runs"), paper / "truth")


def test_every_figure_is_drawn(paper: Path, tmp_path: Path) -> None:
    drawn = draw(read_runs(paper / "runs"), tmp_path / "figures", paper / "truth")
    assert drawn.left_out == ()
    assert [figure.path.stem for figure in drawn.figures] == list(DRAW)
    assert sorted(path.name for path in (tmp_path / "figures").iterdir()) == sorted(f"{n}.png" for n in DRAW)
    for figure in drawn.figures:
        picture = cv2.imread(str(figure.path))
        assert len(np.unique(picture.reshape(-1, 3), axis=0)) > 50
        assert figure.path.stat().st_size <= LARGEST_FILE
        assert "A phantom is not C3VD" in figure.caption
        assert "Data: phantom, split paper" in figure.caption


@pytest.mark.parametrize("given", [None, "nowhere", "cut off"])
def test_without_truth_figures_of_numbers_are_drawn(paper: Path, tmp_path: Path, given: str | None) -> None:
    truth = None if given is None else tmp_path / given
    if given == "cut off":
        shutil.copytree(paper / "truth", tmp_path / given)
        (tmp_path / given / "index.json").unlink()
    (tmp_path / "out").mkdir()
    (tmp_path / "out" / "qualitative.png").write_text("of someone")
    drawn = draw(read_runs(paper / "runs"), tmp_path / "out", truth)
    assert [f.path.stem for f in drawn.figures] == [name for name in DRAW if name not in NEED_TRUTH]
    assert [line.partition(": ")[0] for line in drawn.left_out] == [
        f"figure {DRAW[n][0]!r}" for n in NEED_TRUTH
    ]
    assert all("images and true depth was not given or is not complete" in line for line in drawn.left_out)
    assert (tmp_path / "out" / "qualitative.png").read_text() == "of someone"


def drop_predictions(root: Path) -> None:
    for path in root.glob("runs/*/predictions_test"):
        shutil.rmtree(path)


def drop_normals(root: Path) -> None:
    for path in root.glob("runs/*/predictions_test"):
        keep(path, 0, normals=False)


def drop_metrics(root: Path) -> None:
    for path in root.glob("runs/*/metrics.csv"):
        path.unlink()


def keep_one(root: Path) -> None:
    for path in root.glob("runs/*"):
        if path.name != "bts_0":
            shutil.rmtree(path)


def other_size(root: Path) -> None:
    writer = PredictionWriter(root / "truth", {"max_depth": 100.0})
    for video in VIDEOS:
        for n in range(FRAMES):
            writer.add(video, n, np.full((5, 6), 9.0), None, np.zeros((5, 6, 3)))
    writer.finish()


CASES: list[tuple[Callable[[Path], None], dict[str, str]]] = [
    (
        drop_predictions,
        dict.fromkeys([n for n in NEED_TRUTH if n != "data_sheet"], "callbacks.predictions=true keeps them"),
    ),
    (drop_normals, {"qualitative_normals": "no method predicts normals"}),
    (drop_metrics, {"training_curves": "no run has a metrics.csv with values by epoch"}),
    (
        keep_one,
        {
            "qualitative_normals": "no method predicts normals",
            "ablation_errors": "fewer than two rows of the ablation were run",
            "lambda_study": "fewer than two triples of weights were run",
        },
    ),
    (
        other_size,
        {n: "5 x 6" for n in NEED_TRUTH if n not in ("data_sheet", "qualitative_normals")}
        | {"qualitative_normals": "the truth has no normals"},
    ),
]


@pytest.mark.parametrize(("spoil", "missing"), CASES, ids=[spoil.__name__ for spoil, _ in CASES])
def test_what_is_missing_is_named(
    paper: Path, tmp_path: Path, spoil: Callable[[Path], None], missing: dict[str, str]
) -> None:
    root = tmp_path / "copy"
    shutil.copytree(paper, root)
    spoil(root)
    drawn = draw(read_runs(root / "runs"), tmp_path / "out", root / "truth")
    titles = {title: name for name, (title, _) in DRAW.items()}
    reasons = {titles[line.split("'")[1]]: line for line in drawn.left_out}
    assert reasons.keys() == missing.keys()
    assert all(words in reasons[name] for name, words in missing.items())
    assert [f.path.stem for f in drawn.figures] == [name for name in DRAW if name not in missing]


def test_without_runs(tmp_path: Path) -> None:
    assert draw_all(Found((), ()), tmp_path / "out", None) == []


def run_of(abs_rel: list[float], segments: list[str] | None = None) -> Run:
    count = len(abs_rel)
    frames = {
        "video": np.array(["a"] * (count - 1) + ["b"]),
        "segment": np.array(segments or ["cecum"] * count),
        "frame": np.arange(count) * 3,
        "abs_rel": np.array(abs_rel),
    }
    return Run(Path("r"), {}, {"seed": 0, "split": "test"}, frames, "r")


def test_best_average_and_worst() -> None:
    """The mean of the values is 0.5; equals go to the first."""
    run = run_of([0.9, 0.1, np.nan, 0.45, 0.1, 0.52, 0.93])
    assert choice.best_average_worst(run) == {("a", 3): "best", ("a", 15): "average", ("b", 18): "worst"}
    assert choice.best_average_worst(run_of([0.2])) == {("b", 0): "best, average, worst"}


def test_the_middle_frame_of_each_segment() -> None:
    run = run_of([0.1] * 6, ["sigmoid", "sigmoid", "cecum", "cecum", "cecum", "other"])
    assert choice.one_a_segment(run) == {("a", 9): "cecum", ("a", 3): "sigmoid", ("b", 15): "other"}


def test_the_best_method_is_that_of_the_lowest_mean(material: FigureData) -> None:
    means = {m.label: np.mean(m.runs[0].frames["abs_rel"]) for m in material.main.methods}
    assert material.main.best(material.main.methods).label == min(means, key=lambda label: means[label])


def test_quartiles_equal_a_slow_loop() -> None:
    random = np.random.default_rng(0)
    values, against = random.random(500), random.integers(0, 40, 500) / 2.0
    edges = np.array([0.0, 2.0, 2.5, 7.0, 19.0])
    found = quartiles(values, against, edges, fewest=20)
    for i in range(len(edges) - 1):
        part = [v for v, x in zip(values, against, strict=True) if edges[i] <= x < edges[i + 1]]
        assert found.counts[i] == len(part)
        expected = [np.percentile(part, q) for q in (25, 50, 75)] if len(part) >= 20 else [np.nan] * 3
        assert np.array_equal([found.lower[i], found.median[i], found.upper[i]], expected, equal_nan=True)
    assert np.isnan(found.median).any()
    assert not np.isnan(found.median).all()


def test_pixels_of_errors_are_those_that_count(material: FigureData) -> None:
    method, frames = material.main.methods[0], [("cecum_t2_a", 0), ("trans_t3_b", 2)]
    truth = material.known_truth()
    pixels = error_against.read_pixels(truth, method, frames)
    stored = StoredPredictions(method.shown.folder / "predictions_test")
    relative = []
    for frame in frames:
        depth, guess = truth.read(*frame)[0], stored.read(*frame)[0]
        relative += [abs(g - d) / d for d, g in zip(depth.flat, guess.flat, strict=True) if d > 0]
    assert np.allclose(pixels.values["relative"], relative, rtol=1e-6)
    assert len(relative) == 2 * (SIZE[0] - 1) * SIZE[1]
    assert pixels.curve("relative", "depth")[1].counts.sum() == len(relative)
    assert pixels.curve("absolute", "off_axis")[1].counts.sum() == len(relative)


def test_frames_are_evenly_spaced(material: FigureData) -> None:
    assert error_against.evenly(material.main.methods[0]) == [
        (v, n) for v in sorted(VIDEOS) for n in range(FRAMES)
    ]


def test_errors_of_maps(material: FigureData) -> None:
    frame = ("desc_t4_a", 1)
    method = next(m for m in material.main.methods if m.label == "Col3D-MTL")
    known = read_truth(material.known_truth(), frame)
    guess = read_guess(method, frame, known)
    assert not known.mask[0].any()
    assert known.mask[1:].all()
    assert np.array_equal(guess.error, abs(guess.depth - known.depth))
    assert guess.angle is not None
    assert guess.normals is not None
    assert known.normals is not None
    cosine = (guess.normals.astype(float) * known.normals).sum(-1)
    assert np.abs(guess.angle - np.degrees(np.arccos(cosine.clip(-1, 1)))).max() < 0.01


def test_small_angles_are_not_lost() -> None:
    turned = np.array([[np.sin(1e-6), 0, np.cos(1e-6)]])
    assert angle_between(turned, np.array([[0, 0, 1.0]]))[0] == pytest.approx(np.degrees(1e-6), rel=1e-9)


def test_colours_of_methods_are_fixed(paper: Path, material: FigureData) -> None:
    """Whatever else was run, and the same in every table; variants of a network differ by their dashes."""
    alone = figure_data_of(Found(read_runs(paper / "runs").runs[:1], ()), None)
    styles = {m.label: m.style for group in material.groups.values() for m in group.methods}
    assert {m.label: m.style for m in alone.main.methods}.items() <= styles.items()
    assert len({styles[label].colour for label in (m.label for m in material.main.methods)}) == 5
    assert styles["Col3D-MTL"] == styles["Col3D-MTL (L1)"]
    assert styles["Col3D-MTL"].colour == styles["Col3D-MTL (L2)"].colour
    assert styles["Col3D-MTL"].dash != styles["Col3D-MTL (L2)"].dash


def test_colours_are_those_of_registrations_and_else_of_a_palette() -> None:
    """Runs of before have recorded none: networks then take turns, in the same order each time."""
    given = Look("Mine", "#123456")
    styles = styles_of({"Mine": given, "Mine (L2)": given, "run 1": Look("Theirs", "#654321")})
    assert styles["Mine"] == Style("#123456")
    assert styles["Mine (L2)"] == Style("#123456", "--")
    assert styles["run 1"] == Style("#654321")
    several = styles_of({"run 1": given, "run 2": given, "other": Look("Other", PALETTE[0])})
    assert [style.colour for style in several.values()] == [PALETTE[1], PALETTE[2], PALETTE[0]]
    before = styles_of({name: Look("BTS", "") for name in ("BTS", "BTS (L1)", "BTS (L2)")})
    assert list(before.values()) == [Style(PALETTE[0]), Style(PALETTE[0]), Style(PALETTE[0], "--")]
    others = styles_of({f"run {n}": Look("net", "") for n in range(20)})
    assert len(set(others.values())) == 20


def test_the_ball_is_the_key_of_normals() -> None:
    """Its right is red, its top green, and its middle, which faces the camera, blue."""
    key = ball(101)
    assert key[50, 95, 0] > 0.9
    assert key[5, 50, 1] > 0.9
    assert np.allclose(key[50, 50], [0.5, 0.5, 1.0, 1.0], atol=0.01)
    assert key[0, 0, 3] == 0


def test_triples_of_weights_are_in_the_order_of_abs_rel(material: FigureData) -> None:
    lines = lambda_study.lines_of(material.groups["lambda"])
    assert {line.label: line.weights for line in lines} == {
        "(0.5, 0.3, 0.2)": (0.5, 0.3, 0.2),
        "(0.4, 0.3, 0.3)": (0.4, 0.3, 0.3),
    }
    assert lines[0].results[0] < lines[1].results[0]


def test_curves_are_values_by_epoch(material: FigureData) -> None:
    found = training_curves.curves(material.main.methods[0].runs[0])
    assert {name: (x.tolist(), y.tolist()) for name, (x, y) in found.items()} == {
        "val/abs_rel": ([1, 2], [0.5, 0.4]),
        "val/angle_mean": ([1, 2], [30.0, 20.0]),
        "train/loss": ([1, 2], [4.0, 2.0]),
        "val/loss": ([1, 2], [3.0, 2.5]),
    }


def test_single_runs_of_other_options_are_compared(tmp_path: Path) -> None:
    """A benchmark of one method is shown beside the other runs of its setting, once each."""
    write_run(tmp_path / "one", "bts", frames=FRAMES)
    write_run(
        tmp_path / "two", "bts", frames=FRAMES, model__width=64, loss__terms={"depth": {"term": "depth_l1"}}
    )
    labels = [method.label for method in figure_data_of(read_runs(tmp_path), None).main.methods]
    assert labels == ["BTS", "two"]


def test_large_pictures_are_made_smaller(tmp_path: Path) -> None:
    canvas = blank(8.0, 6.0)
    canvas.subplots().imshow(np.random.default_rng(0).random((500, 600, 3)))
    save(canvas, tmp_path / "noise.png")
    assert [path.name for path in tmp_path.iterdir()] == ["noise.png"]
    assert cv2.imread(str(tmp_path / "noise.png")).shape[1] < 800


def test_captions_name_other_data(paper: Path, tmp_path: Path) -> None:
    """The sentence on the phantom is for the phantom alone."""
    root = tmp_path / "runs"
    write_run(root / "one", "bts", frames=FRAMES, facts={"data": "c3vd"}, data__name="c3vd")
    (root / "one" / "metrics.csv").write_text("epoch,val/abs_rel\n0,0.5\n")
    captions = [figure.caption for figure in draw_all(read_runs(root), tmp_path / "out", None)]
    assert len(captions) == 2
    assert all("phantom" not in caption and "Data: c3vd" in caption for caption in captions)
    assert json.loads((root / "one" / "summary.json").read_text())["data"] == "c3vd"


def test_metrics_of_plugins_are_drawn_beside_ours(tmp_path: Path) -> None:
    """With their units and signs as they are, from 0 unless values are below; none of ours joins them."""
    folder = write_run(tmp_path / "runs" / "bts")
    rows = [{**row, "gain": -1.5, "mae": 2.0} for row in read_per_frame(folder / "per_frame.csv")]
    write_per_frame(folder / "per_frame.csv", rows, [*OURS, "gain"])
    change_summary(folder, metric_specs={"gain": {"heading": "Gain $x^$", "unit": "$", "better": "higher"}})
    curve = "epoch,val/abs_rel,val/mae,val/gain,val/loss\n0,0.5,2.0,-3.0,1.0\n"
    (folder / "metrics.csv").write_text(curve)
    material = figure_data_of(read_runs(tmp_path / "runs"), None)
    said = [module.draw(material, tmp_path).caption for module in (per_video, training_curves)]
    assert all(text.startswith("Abs Rel (lower is better) and Gain $x^$ (higher is better)") for text in said)
    assert axis_label(material.main.methods[0].runs[0].specs["gain"]) == r"Gain \$x^\$ \$"
