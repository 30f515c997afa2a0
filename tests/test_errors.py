"""Errors that name the argument, the rule and what came."""

import pytest

from col3d.errors import DataError, check_known, nearest_name

NAMES = ("bts", "bts_cbam", "newcrfs")


@pytest.mark.parametrize("name", NAMES)
def test_a_known_name_comes_back(name: str) -> None:
    assert check_known("model", name, NAMES) == name


def test_an_unknown_name_is_told_with_the_nearest_and_all() -> None:
    with pytest.raises(
        ValueError, match=r"^model: 'newcrf' is unknown; did you mean 'newcrfs'\?.*bts, bts_cbam"
    ):
        check_known("model", "newcrf", NAMES)


def test_no_hint_where_nothing_is_near() -> None:
    assert nearest_name("zzz", NAMES) == ""
    with pytest.raises(ValueError, match="'' is unknown") as caught:
        check_known("model", "", NAMES)
    assert "mean" not in str(caught.value)


def test_known_names_may_come_from_a_generator() -> None:
    assert check_known("model", "bts", (name for name in NAMES)) == "bts"
    with pytest.raises(ValueError, match="known: bts, bts_cbam, newcrfs"):
        check_known("model", "other", (name for name in NAMES))


def test_data_errors_are_value_errors() -> None:
    assert issubclass(DataError, ValueError)
