"""Time and memory of small networks, and what is made of them."""

from pathlib import Path

import pytest

from benchmarks.scaling import CARDS, GB, KEPT_FREE, Point, fits, line_through, main


def test_all_is_measured_and_drawn(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    out = tmp_path / "scaling.png"
    small = "--sides 64 96 --encoder lcnet_035 --width 64 --repeats 1"
    main([*small.split(), "--out", str(out)])
    said = capsys.readouterr().out
    assert all(f"| {side} | {batch} |" in said for side in (64, 96) for batch in (1, 2, 4))
    assert out.stat().st_size > 0


def test_what_fits_is_on_the_line() -> None:
    """1 GB without a frame, 0.5 GB for each frame of 320 x 320."""
    each = 0.5 * GB / 320**2
    points = [Point(s, b, 1.0, GB + each * b * s**2) for s in (128, 320) for b in (1, 2)]
    assert line_through(points) == pytest.approx((GB, each))
    room = [int((card - 1 - KEPT_FREE) / 0.5) for card in CARDS]
    assert fits(points, [320])[-1] == f"| 320 | {room[0]} | {room[1]} | {room[2]} |"
