"""Texts of camera files as plain values: JSON, YAML and XML, OpenCV's storage among them, lines, a matrix."""

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
    """What a text holds: names with values, or the rows of a matrix.

    Raises:
        ValueError: says what is wrong with it.
    """
    text = text.lstrip("\ufeff").strip()
    if text.startswith("<"):
        return _xml(text)
    if text.startswith(("{", "[")) and not _is_rows(text):
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
    found: dict[Any, Any] = {}
    for name, value in pairs:
        if name in found:
            raise ValueError(f"{name}: given twice")
        found[name] = value
    return found


def _is_rows(text: str) -> bool:
    """Whether this is how NumPy prints a matrix: brackets and no commas."""
    return text.startswith("[[") and "," not in text


def _numbers_in(line: str) -> list[float] | None:
    """The numbers of a line of nothing else."""
    words = line.translate(str.maketrans("[](),;\t", "       ")).split()
    if not words or not all(NUMBER.fullmatch(word) for word in words):
        return None
    return [float(word) for word in words]


def _matrix(text: str) -> dict[str, Any]:
    """Rows of numbers, and lines `height = 480` or `# width = 640` beside them."""
    rows, others = [], []
    for line in text.splitlines():
        bare = line.strip().lstrip("#%; ")
        if (found := _numbers_in(line)) is not None:
            rows.append(found)
        elif re.fullmatch(r"\w+\s*[=:]\s*\S+", bare):
            others.append(bare)
        elif bare and not line.strip().startswith(COMMENTS):
            raise ValueError(f"expected rows of numbers, got {line.strip()[:80]!r}")
    given = _settings("\n".join(others)) if others else {}
    return {**given, "K": rows}


def _settings(text: str) -> dict[str, Any]:
    """Lines `name = value`."""
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
    """Plain YAML, with OpenCV's matrices, and without aliases, which could unfold without bounds."""

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
        documents = [found for found in yaml.load_all(text, _Loader) if found is not None]
    except yaml.YAMLError as error:
        raise ValueError(f"expected JSON, YAML or lines of names and values ({_line(error)})") from None
    if len(documents) != 1:
        raise ValueError(f"expected one document, got {len(documents)}")
    return _with_numbers(documents[0])


def _line(error: Exception) -> str:
    return " ".join(str(error).split())[:120]


def _with_numbers(value: Any) -> Any:
    """YAML takes `1e-3` for a text."""
    if isinstance(value, dict):
        return {str(name): _with_numbers(inner) for name, inner in value.items()}
    if isinstance(value, list):
        return [_with_numbers(inner) for inner in value]
    return float(value) if isinstance(value, str) and NUMBER.fullmatch(value) else value


def _xml(text: str) -> dict[str, Any]:
    """OpenCV's storage; or the parameters of a camera model of Vicalib."""
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
    found = _numbers_in(text)
    if found is None:
        return text.strip("\"'")
    return found[0] if len(found) == 1 and not text.startswith("[") else found


def flattened(value: Any) -> Any:
    """The numbers of a matrix in one list, whichever way it is written; all else as it is."""
    if isinstance(value, dict) and "data" in value:
        value = value["data"]
    if isinstance(value, list) and value and all(isinstance(row, list) for row in value):
        return [number for row in value for number in row]
    return value
