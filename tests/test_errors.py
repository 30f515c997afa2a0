"""Errors that name the argument, the rule and what came."""

import pytest
from refusals import Refusal, refusal, refused

from col3d.errors import DataError, DiskError, DivergedError, OptionError, RunLockedError, UserError
from col3d.nearest_names import check_known, nearest_name

NAMES = ("bts", "bts_cbam", "newcrfs")


@pytest.mark.parametrize("name", NAMES)
def test_a_known_name_comes_back(name: str) -> None:
    assert check_known("model", name, NAMES) == name


def test_an_unknown_name_is_told_with_the_nearest_and_all() -> None:
    with refused(OptionError, "model", "'newcrf'", "'newcrfs'", ", ".join(NAMES)):
        check_known("model", "newcrf", NAMES)


def test_no_hint_where_nothing_is_near() -> None:
    assert nearest_name("zzz", NAMES) == ""
    with refused(OptionError, "model", "''") as caught:
        check_known("model", "", NAMES)
    assert "mean" not in str(caught.value)


def test_known_names_may_come_from_a_generator() -> None:
    assert check_known("model", "bts", (name for name in NAMES)) == "bts"
    with refused(OptionError, "model", "'other'", ", ".join(NAMES)):
        check_known("model", "other", (name for name in NAMES))


def test_data_errors_are_value_errors() -> None:
    assert issubclass(DataError, ValueError)


@pytest.mark.parametrize(
    "kind", [DataError, DiskError, OptionError, UserError, RunLockedError, DivergedError]
)
@pytest.mark.parametrize(
    ("message", "about"),
    [
        ("data.root: no such folder: /frames", "data.root"),
        ("the loss is nan", ""),
        ("two faults\na.png: cut off", ""),
        ("a:b.png: cut off\nb.png: not an image", "a:b.png"),
        ("", ""),
    ],
)
def test_an_error_knows_what_it_is_about(
    kind: type[DataError | OptionError | UserError | DivergedError], message: str, about: str
) -> None:
    assert kind(message).about == about


@pytest.mark.parametrize(
    ("kind", "about", "named"),
    [
        (DataError, "model", "'newcrf'"),
        (OptionError, "mode", "'newcrf'"),
        (OptionError, "model", "'newcr'"),
        (OptionError, "model", 2),
    ],
)
def test_another_refusal_fails_a_test(kind: type[ValueError], about: str, named: object) -> None:
    with pytest.raises((OptionError, AssertionError)), refused(kind, about, named):
        check_known("model", "newcrf", ("v2", "12", "2.5"))


def test_the_line_of_a_program_is_read() -> None:
    assert refusal("error: data.root: no such folder: a\n") == Refusal(
        "data.root", "data.root: no such folder: a"
    )
    for printed in ("", "data.root: no such folder\n", "error: a: b\nerror: c: d\n"):
        with pytest.raises(AssertionError):
            refusal(printed)
