"""The server of these tests."""

from collections.abc import Iterator

import pytest
from dataverse import Dataverse, served


@pytest.fixture
def dataverse() -> Iterator[Dataverse]:
    with served(Dataverse()) as has:
        yield has
