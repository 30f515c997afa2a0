"""Train/test leakage of a split: what its test videos share with its training videos."""

from collections.abc import Sequence
from dataclasses import dataclass

from col3d.data.datasets.videos import described, seeded_name
from col3d.data.splits import selection_of_any_video


@dataclass(frozen=True)
class Shared:
    """One test video, and the training videos that share its video, surface, phantom or texture.

    C3VD's videos are of four phantoms, one for each segment, each with some of four textures; C3VDv2's are of
    two colons of seven and eight segments. Two videos of one phantom and texture show the very same surface.
    """

    video: str
    of_video: tuple[str, ...]
    """Training entries of the same video."""
    of_surface: tuple[str, ...]
    """Training videos of the same phantom and texture."""
    of_phantom: tuple[str, ...]
    """Training videos of the same phantom, with any texture."""
    of_texture: tuple[str, ...]
    """Training videos of the same texture, on any phantom."""

    @property
    def worst(self) -> str:
        """The closest thing that training shares with the video, in words."""
        groups = (self.of_video, self.of_surface, self.of_phantom, self.of_texture)
        names = ("the video itself", "phantom and texture", "the phantom", "the texture")
        return next((name for name, videos in zip(names, groups, strict=True) if videos), "nothing")


def shared_with_training(train: Sequence[str], test: Sequence[str]) -> list[Shared]:
    """For every test video, what it shares with the training videos.

    Args:
        train: entries of the split, as `selection_of_any_video` reads them.
        test: likewise; videos that the table does not list share nothing but themselves.
    """
    seen = list(dict.fromkeys(selection_of_any_video(entry).video for entry in train))
    tested = dict.fromkeys(selection_of_any_video(entry).video for entry in test)
    return [_shared(video, seen) for video in tested]


def _shared(video: str, seen: Sequence[str]) -> Shared:
    itself, row = seeded_name(video, 0), described(video)
    others = [other for other in seen if seeded_name(other, 0) != itself]
    alike: dict[str, tuple[bool, bool]] = {}
    for other in others:
        other_row = described(other)
        # rendered videos of other seeds share neither surface nor camera path
        if row is not None and other_row is not None and seeded_name(other, 0)[1] == itself[1]:
            same_phantom = (other_row.colon, other_row.segment) == (row.colon, row.segment)
            alike[other] = (same_phantom, other_row.texture == row.texture)
    return Shared(
        video,
        tuple(other for other in seen if other not in others),
        tuple(other for other in alike if alike[other] == (True, True)),
        tuple(other for other in alike if alike[other][0]),
        tuple(other for other in alike if alike[other][1]),
    )
