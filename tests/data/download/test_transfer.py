"""Files come whole over any connection, from where the last attempt ended, or not at all and say why."""

import hashlib
import threading
from pathlib import Path

import pytest
from dataverse import DOI, Dataverse, zipped
from refusals import refused

from col3d.data.download import Interrupted, RemoteFile, Server, ServerError, fetch, list_files, unpacked_size

NAME = "c0_cecum_t1_v1.zip"
CONTENT = bytes(range(256)) * 3000


@pytest.fixture
def remote(dataverse: Dataverse) -> RemoteFile:
    dataverse.files[NAME] = CONTENT
    return list_files(server_of(dataverse), DOI).archives["cecum_t1_a"]


def server_of(dataverse: Dataverse, attempts: int = 4) -> Server:
    return Server(dataverse.url, timeout=5.0, attempts=attempts, pause=0.01)


def test_files_are_listed_by_the_names_of_their_videos(dataverse: Dataverse) -> None:
    dataverse.files = {
        NAME: b"a",
        "trans_t1_a.zip": b"bc",
        "c1_cecum_t1_v1.zip": b"",
        "README.txt": b"",
        "x.zip": b"",
    }
    listing = list_files(server_of(dataverse), DOI)
    assert listing.licence == "CC BY-NC-SA 4.0"
    assert list(listing.archives) == ["cecum_t1_a", "trans_t1_a", "c1_cecum_t1_v1"]
    assert listing.archives["trans_t1_a"] == RemoteFile(
        "trans_t1_a.zip", 1, 2, "md5", hashlib.md5(b"bc").hexdigest()
    )


@pytest.mark.parametrize(
    "answer", [b"<html>", b"[]", b'{"data": {}}', b'{"data": {"latestVersion": {"files": [3]}}}']
)
def test_an_answer_that_is_no_list_is_refused(dataverse: Dataverse, answer: bytes) -> None:
    dataverse.lists = answer
    with refused(ServerError, None, DOI, "server="):
        list_files(server_of(dataverse), DOI)


def test_another_doi_is_not_found(dataverse: Dataverse) -> None:
    with refused(ServerError, None, "persistentId=doi:10.1/X: ", "404 Not Found"):
        list_files(server_of(dataverse), "doi:10.1/X")


def test_a_file_comes_whole(dataverse: Dataverse, remote: RemoteFile, tmp_path: Path) -> None:
    told: list[int] = []
    fetch(server_of(dataverse), remote, tmp_path / NAME, told.append)
    assert (tmp_path / NAME).read_bytes() == CONTENT
    assert [path.name for path in tmp_path.iterdir()] == [NAME]
    assert told == sorted(told)
    assert told[-1] == len(CONTENT)


def test_a_connection_that_breaks_is_gone_on_with(
    dataverse: Dataverse, remote: RemoteFile, tmp_path: Path
) -> None:
    dataverse.drops = [100_000, 0, 300_001, 70_000]
    fetch(server_of(dataverse), remote, tmp_path / NAME)
    assert (tmp_path / NAME).read_bytes() == CONTENT
    assert dataverse.ranges == [None, "bytes=100000-", "bytes=100000-", "bytes=400001-", "bytes=470001-"]


def test_the_same_command_goes_on(dataverse: Dataverse, remote: RemoteFile, tmp_path: Path) -> None:
    dataverse.drops = [200_000, 0]
    with refused(ServerError, NAME, "200000 of 768000", "tried 2 times"):
        fetch(server_of(dataverse, attempts=2), remote, tmp_path / NAME)
    assert (tmp_path / f"{NAME}.partial").read_bytes() == CONTENT[:200_000]
    fetch(server_of(dataverse), remote, tmp_path / NAME)
    assert dataverse.ranges[-1] == "bytes=200000-"
    assert (tmp_path / NAME).read_bytes() == CONTENT


def test_a_server_that_heeds_no_range_begins_anew(
    dataverse: Dataverse, remote: RemoteFile, tmp_path: Path
) -> None:
    dataverse.heeds_ranges, dataverse.drops = False, [200_000]
    fetch(server_of(dataverse), remote, tmp_path / NAME)
    assert (tmp_path / NAME).read_bytes() == CONTENT


@pytest.mark.parametrize("there", [len(CONTENT), len(CONTENT) + 5])
def test_what_is_there_already(dataverse: Dataverse, remote: RemoteFile, tmp_path: Path, there: int) -> None:
    (tmp_path / f"{NAME}.partial").write_bytes((CONTENT + b"12345")[:there])
    fetch(server_of(dataverse), remote, tmp_path / NAME)
    assert (tmp_path / NAME).read_bytes() == CONTENT
    assert len(dataverse.ranges) == (0 if there == len(CONTENT) else 1)


@pytest.mark.parametrize("code", [429, 500, 502, 503, 504])
def test_a_busy_server_is_asked_again(
    dataverse: Dataverse, remote: RemoteFile, tmp_path: Path, code: int
) -> None:
    dataverse.answers = [(code, {"Retry-After": "0"}), (code, {})]
    fetch(server_of(dataverse), remote, tmp_path / NAME)
    assert (tmp_path / NAME).read_bytes() == CONTENT


def test_a_server_that_stays_busy_is_given_up(
    dataverse: Dataverse, remote: RemoteFile, tmp_path: Path
) -> None:
    dataverse.answers = [(503, {})] * 4
    with refused(ServerError, None, "datafile/0: ", "503 Service Unavailable", "tried 4 times"):
        fetch(server_of(dataverse), remote, tmp_path / NAME)
    assert dataverse.answers == []


@pytest.mark.parametrize("code", [401, 403, 404, 410])
def test_a_refusal_is_not_asked_again(
    dataverse: Dataverse, remote: RemoteFile, tmp_path: Path, code: int
) -> None:
    dataverse.answers = [(code, {})] * 2
    with refused(ServerError, None, "datafile/0: ", code):
        fetch(server_of(dataverse), remote, tmp_path / NAME)
    assert len(dataverse.answers) == 1


def test_a_wrong_checksum_is_refused(dataverse: Dataverse, tmp_path: Path) -> None:
    dataverse.files[NAME], dataverse.checksums[NAME] = CONTENT, "0" * 32
    server = server_of(dataverse)
    file = list_files(server, DOI).archives["cecum_t1_a"]
    digest = hashlib.md5(CONTENT).hexdigest()
    with refused(ServerError, NAME, digest, "0" * 32, "fetched 2 times"):
        fetch(server, file, tmp_path / NAME)
    assert list(tmp_path.iterdir()) == []
    assert dataverse.ranges == [None, None]


def test_a_damaged_part_is_fetched_anew(dataverse: Dataverse, remote: RemoteFile, tmp_path: Path) -> None:
    (tmp_path / f"{NAME}.partial").write_bytes(b"x" * 1000)
    fetch(server_of(dataverse), remote, tmp_path / NAME)
    assert (tmp_path / NAME).read_bytes() == CONTENT
    assert dataverse.ranges == ["bytes=1000-", None]


def test_a_file_that_is_longer_than_listed(dataverse: Dataverse, tmp_path: Path) -> None:
    dataverse.files[NAME], dataverse.sizes[NAME] = CONTENT, 1000
    server = server_of(dataverse)
    with refused(ServerError, NAME, "1000 bytes"):
        fetch(server, list_files(server, DOI).archives["cecum_t1_a"], tmp_path / NAME)


def test_a_file_that_is_shorter_than_listed(dataverse: Dataverse, tmp_path: Path) -> None:
    dataverse.files[NAME], dataverse.sizes[NAME] = b"abc", 1000
    server = server_of(dataverse, attempts=2)
    dataverse.heeds_ranges = False
    with refused(ServerError, NAME, "3 of 1000", "tried 2 times"):
        fetch(server, list_files(server, DOI).archives["cecum_t1_a"], tmp_path / NAME)


def test_no_network_is_said(tmp_path: Path) -> None:
    with refused(ServerError, None, "http://127.0.0.1:9", "(Connection refused)", "tried 2 times"):
        list_files(Server("http://127.0.0.1:9", attempts=2, pause=0.01), DOI)


def test_a_stop_leaves_what_was_fetched(dataverse: Dataverse, remote: RemoteFile, tmp_path: Path) -> None:
    stop = threading.Event()
    server = Server(dataverse.url, timeout=5.0, pause=0.01, stop=stop)

    def told(done: int) -> None:
        if done > 0:
            stop.set()

    with pytest.raises(Interrupted):
        fetch(server, remote, tmp_path / NAME, told)
    left = (tmp_path / f"{NAME}.partial").read_bytes()
    assert 0 < len(left) < len(CONTENT)
    assert CONTENT.startswith(left)


def test_the_size_of_what_is_in_an_archive_is_known_before(dataverse: Dataverse) -> None:
    dataverse.files[NAME] = zipped({"a/0000_color.png": b"0" * 100_000, "a/pose.txt": b"1" * 23})
    server = server_of(dataverse)
    file = list_files(server, DOI).archives["cecum_t1_a"]
    assert unpacked_size(server, file) == 100_023
    dataverse.files[NAME] = b"no archive"
    assert unpacked_size(server, list_files(server, DOI).archives["cecum_t1_a"]) is None
