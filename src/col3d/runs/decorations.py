"""Optional outputs, such as cost, panels and page: a failure prints a note, and the result stands."""

from collections.abc import Iterator, Sequence
from contextlib import contextmanager


class Decorations:
    """Makes optional outputs one by one; a failure prints a note and is recorded.

    Args:
        again: clause for the note that says how to make them again.

    Attributes:
        undone: names of the outputs that failed.
    """

    def __init__(self, again: str) -> None:
        self.again, self.undone = again, list[str]()

    @contextmanager
    def attempt(self, name: str) -> Iterator[None]:
        """Make an output in the block; an exception becomes a note."""
        try:
            yield
        except Exception as error:  # whatever the error, the result stands
            reason = " ".join(str(error).split())[:300]
            message = (
                reason
                if type(error).__name__ in ("UserError", "DataError")
                else f"{type(error).__name__}: {reason}"
            )
            print(f"note: {name} failed ({message.rstrip(': ')}); {self.again}", flush=True)
            self.undone.append(name)

    def failed(self, names: Sequence[str]) -> list[str]:
        """Return those of some names that failed."""
        return [name for name in names if name in self.undone]
