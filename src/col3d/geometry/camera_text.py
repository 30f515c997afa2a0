"""Parse texts of camera files: JSON, YAML, XML, OpenCV's storage, lines of settings, or a matrix."""

import configparser
import json
import re
from collections.abc import Hashable, Iterable
from typing import Any
from xml.etree import ElementTree

import yaml

OPENCV_MATRIX = "tag:yaml.org,2002:opencv-matrix"
COMMENTS = ("#", ";", "//", "%")
NUMBER = re.compile(r"[-+]?(\d+\.?\d*|\.\d+)([eE][-+]?\d+)?")


def plain_from_text(text: str) -> Any:
    """Parse a text to names with values, or to the rows of a matrix.

    Raises:
        ValueError: says what is wrong with it.
    """
    text = text.lstrip("\ufeff").strip()
    if text.startswith("<"):
        return _xml(text)
    if text.startswith("{") or (text.startswith("[") and not _is_rows(text)):
        return json.loads(text, object_pairs_hook=_once)
    lines = [line for line in text.splitlines() if line.strip() and not line.strip().startswith(COMMENTS)]
    if not lines:
        raise ValueError("expected numbers of a lens, got an empty file")
    if _numbers_in(lines[0]) is not None:
        return _matrix(text)
    if re.match(r"\s*[\w.]+\s*=", lines[0]):
        return _settings(text)
    return _yaml("\n".join(lines))


def _once(pairs: Iterable[tuple[Any, Any]]) -> dict[Any, Any]:
    values: dict[Any, Any] = {}
    for name, value in pairs:
        if name in values:
            raise ValueError(f"{name}: given twice")
        values[name] = value
    return values


def _is_rows(text: str) -> bool:
    """Whether a text is a matrix as NumPy or MATLAB prints it: brackets without commas, or semicolons."""
    first = text.splitlines()[0]
    return _numbers_in(first) is not None and ("," not in text or ";" in text)


def _numbers_in(line: str) -> list[float] | None:
    """The numbers of a line that holds nothing else; None for any other line."""
    words = line.translate(str.maketrans("[](),;\t", "       ")).split()
    if not words or not all(NUMBER.fullmatch(word) for word in words):
        return None
    return [float(word) for word in words]


def _matrix(text: str) -> dict[str, Any]:
    """Parse rows of numbers, and lines such as `height = 480` or `# width = 640` beside them."""
    rows, others = [], []
    for line in text.splitlines():
        bare = line.strip().lstrip("#%; ")
        if (row := _numbers_in(line)) is not None:
            rows.append(row)
        elif re.fullmatch(r"\w+\s*[=:]\s*\S+", bare):
            others.append(bare)
        elif bare and not line.strip().startswith(COMMENTS):
            raise ValueError(f"expected rows of numbers, got {line.strip()[:80]!r}")
    given = _settings("\n".join(others)) if others else {}
    return {**given, "K": rows}


def _settings(text: str) -> dict[str, Any]:
    """Parse lines `name = value`."""
    parser = configparser.ConfigParser(
        inline_comment_prefixes=(";", "#", "//"), comment_prefixes=("#", ";", "//"), interpolation=None
    )
    try:
        parser.read_string("[camera]\n" + text)
    except configparser.Error as error:
        raise ValueError(" ".join(str(error).split())) from None
    if len(parser.sections()) > 2:
        raise ValueError(f"expected one section, got {parser.sections()[1:]}")
    return {name: _value(value) for section in parser.sections() for name, value in parser[section].items()}


def _value(text: str) -> Any:
    """A number, a list of them, or a text."""
    bare = text.strip().rstrip(",").strip("\"'")
    if NUMBER.fullmatch(bare):
        return float(bare)
    listed = _numbers_in(bare) if any(mark in bare for mark in "[](, ") else None
    return bare if listed is None else listed


class _Loader(yaml.SafeLoader):
    """YAML loader with OpenCV's matrices, and without aliases, which could expand without bounds."""

    def compose_node(self, parent: Any, index: Any) -> Any:
        if self.check_event(yaml.AliasEvent):
            raise ValueError("expected plain YAML, without aliases")
        return super().compose_node(parent, index)

    def construct_mapping(self, node: Any, deep: bool = False) -> dict[Hashable, Any]:
        pairs = [
            (self.construct_object(key), self.construct_object(value, True)) for key, value in node.value
        ]
        return _once(pairs)


_Loader.add_constructor(OPENCV_MATRIX, _Loader.construct_mapping)


def _yaml(text: str) -> Any:
    try:
        documents = [document for document in yaml.load_all(text, _Loader) if document is not None]
    except yaml.YAMLError as error:
        raise ValueError(f"expected JSON, YAML or lines of names and values ({_line(error)})") from None
    if len(documents) != 1:
        raise ValueError(f"expected one document, got {len(documents)}")
    return _with_numbers(documents[0])


def _line(error: Exception) -> str:
    return " ".join(str(error).split())[:120]


def _with_numbers(value: Any) -> Any:
    """Convert texts such as `1e-3` to numbers, which YAML leaves as texts."""
    if isinstance(value, dict):
        return {str(name): _with_numbers(inner) for name, inner in value.items()}
    if isinstance(value, list):
        return [_with_numbers(inner) for inner in value]
    return float(value) if isinstance(value, str) and NUMBER.fullmatch(value) else value


def _xml(text: str) -> dict[str, Any]:
    """Parse OpenCV's storage, or the parameters of a camera model of Vicalib."""
    if "<!" in text.replace("<!--", ""):
        raise ValueError("expected XML without declarations of types")
    try:
        root = ElementTree.fromstring(text)
    except ElementTree.ParseError as error:
        raise ValueError(f"expected XML that can be read ({error})") from None
    if root.tag == "opencv_storage":
        return _once((child.tag, _node(child)) for child in root)
    models = list(root.iter("camera_model"))
    if len(models) != 1:
        raise ValueError(
            f"expected <opencv_storage> or one <camera_model>, got {len(models)} in <{root.tag}>"
        )
    fields = _once((child.tag, _node(child)) for child in models[0])
    return {"vicalib": models[0].get("type", ""), **fields}


def _node(node: ElementTree.Element) -> Any:
    """A number, a list of them, names with values, or a text."""
    if len(node):
        return _once((child.tag, _node(child)) for child in node)
    text = (node.text or "").strip()
    values = _numbers_in(text)
    if values is None:
        return text.strip("\"'")
    return values[0] if len(values) == 1 and not text.startswith("[") else values


def flattened(value: Any) -> Any:
    """The numbers of a matrix in one list, in whichever form it is written; other values unchanged."""
    if isinstance(value, dict) and "data" in value:
        value = value["data"]
    if isinstance(value, list) and value and all(isinstance(row, list) for row in value):
        return [number for row in value for number in row]
    return value
