"""Option type: the program that saved a file of published weights."""

from typing import TYPE_CHECKING, Literal

from col3d.models.published import SOURCES

if TYPE_CHECKING:
    Published = str
else:
    Published = Literal[*SOURCES]
