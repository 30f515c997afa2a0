"""List the files of a data set on a Dataverse server.

References:
    The Dataverse Project: Native API, "Get JSON Representation of a Dataset"; Data Access API, "Basic File
    Access".
"""

import json
import re
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from pathlib import PurePosixPath
from typing import Any
from urllib.parse import quote

from col3d.data.datasets.videos import canonical_name, catalogue
from col3d.data.download.server import Server, ServerError

SERVER = "https://archive.data.jhu.edu"
DOI = "doi:10.7281/T1/JC64MK"
"""DOI of C3VD and C3VDv2, whose videos are in one data set."""
LICENCE = "CC BY-NC-SA 4.0"
"""Licence of both data sets, by their page: attribution, no commercial use, share alike."""
MANY = 10
HASHES = {"MD5": "md5", "SHA-1": "sha1", "SHA1": "sha1", "SHA-256": "sha256", "SHA-512": "sha512"}
"""Names of checksum algorithms in a Dataverse -> in hashlib."""


@dataclass(frozen=True)
class RemoteFile:
    """A file of the data set.

    Attributes:
        name: name of the file, without folders.
        number: the server's number of the file.
        size: size in bytes.
        hashed_by: name of its checksum's algorithm in hashlib, or empty.
        checksum: in hexadecimal digits, or empty.
    """

    name: str
    number: int
    size: int
    hashed_by: str
    checksum: str

    @property
    def path(self) -> str:
        """Path of a request for the file."""
        return f"/api/access/datafile/{self.number}"


@dataclass(frozen=True)
class Listing:
    """Archives of videos by the video's name here, and the licence that the server names."""

    archives: Mapping[str, RemoteFile]
    licence: str


def list_files(server: Server, doi: str) -> Listing:
    """Request the list of a data set's archives from a Dataverse.

    Args:
        server: server of the Dataverse.
        doi: the data set's, such as `doi:10.7281/T1/JC64MK`.

    Raises:
        ServerError: there is no such data set, or the answer is no list of files.
    """
    path = f"/api/datasets/:persistentId?persistentId={quote(doi, safe=':/')}"
    content = server.read(path)
    try:
        version = json.loads(content)["data"]["latestVersion"]
        archives = _archives(version["files"])
    except (ValueError, TypeError, KeyError, RecursionError):
        raise ServerError(
            f"{server.url}{path}: the answer is no list of files of a Dataverse; is server= right?"
        ) from None
    return Listing(archives, _licence(version))


def chosen(listing: Listing, videos: Iterable[str]) -> dict[str, RemoteFile]:
    """The archives of videos, by their names here.

    Raises:
        ServerError: the server has no archive of one of them.
    """
    videos = list(videos)
    if missing := [video for video in videos if video not in listing.archives]:
        names = ", ".join(catalogue()[video].released_as for video in missing[:MANY])
        more = f" and {len(missing) - MANY} more" if len(missing) > MANY else ""
        raise ServerError(f"videos: the server has no archive of {names}{more}")
    return {video: listing.archives[video] for video in videos}


def _archives(rows: Iterable[Mapping[str, Any]]) -> dict[str, RemoteFile]:
    archives = {}
    for row in rows:
        file = row["dataFile"]
        name = PurePosixPath(str(row.get("label") or file["filename"])).name
        video = canonical_name(name.removesuffix(".zip"))
        if name.endswith(".zip") and video in catalogue():
            hashed_by, checksum = _checksum(file)
            archives[video] = RemoteFile(name, int(file["id"]), int(file["filesize"]), hashed_by, checksum)
    return archives


def _checksum(file: Mapping[str, Any]) -> tuple[str, str]:
    """Algorithm and value of a checksum; both empty where there is none of a known kind."""
    given = file.get("checksum") or {"type": "MD5", "value": file.get("md5")}
    kind, value = HASHES.get(str(given["type"]).upper(), ""), str(given["value"] or "").lower()
    return (kind, value) if kind and re.fullmatch(r"[0-9a-f]{32,128}", value) else ("", "")


def _licence(version: Mapping[str, Any]) -> str:
    """Name of the licence; empty where the server gives none."""
    given = version.get("license")
    name = given.get("name") if isinstance(given, dict) else given
    return str(name or "").strip()[:80]
