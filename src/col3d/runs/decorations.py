"""Optional outputs, such as cost, panels and page: where one fails, a note says so and the result stands."""

from collections.abc import Iterator, Sequence
from contextlib import contextmanager


class Decorations:
    """Makes decorations one by one; what fails is a note, and is kept to be made again.

    Args:
        again: how they are made again, as a clause.
    """

    def __init__(self, again: str) -> None:
        self.again, self.undone = again, list[str]()

    @contextmanager
    def one(self, name: str) -> Iterator[None]:
        """Make one in the block."""
        try:
            yield
        except Exception as error:  # whatever it is, the result stands
            reason = " ".join(str(error).split())[:300]
            said = (
                reason
                if type(error).__name__ in ("UserError", "DataError")
                else f"{type(error).__name__}: {reason}"
            )
            print(f"note: {name} failed ({said.rstrip(': ')}); {self.again}", flush=True)
            self.undone.append(name)

    def but(self, names: Sequence[str]) -> list[str]:
        """Those of some names that are still to be made."""
        return [name for name in names if name in self.undone]
