"""Videos of C3VD and C3VDv2 from the repository that publishes them: list, fetch, check, unpack."""

from col3d.data.download.listing import DOI, LICENCE, SERVER, Listing, RemoteFile, chosen, list_files
from col3d.data.download.server import Interrupted, Server, ServerError
from col3d.data.download.sizes import unpacked_size
from col3d.data.download.transfer import fetch, mismatch
from col3d.data.download.unpack import unpack, unpacked_bytes

__all__ = [
    "DOI",
    "LICENCE",
    "SERVER",
    "Interrupted",
    "Listing",
    "RemoteFile",
    "Server",
    "ServerError",
    "chosen",
    "fetch",
    "list_files",
    "mismatch",
    "unpack",
    "unpacked_bytes",
    "unpacked_size",
]
