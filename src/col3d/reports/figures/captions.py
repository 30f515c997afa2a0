"""Sentences of captions: data and protocol, seeds of predictions, choice of frames."""

from collections.abc import Iterable, Sequence

from col3d.registry.metric_specs import MetricSpec
from col3d.reports.compose import PHANTOM
from col3d.reports.figures.figure_data import Group, Method

UNSCALED = "Predictions are as networks gave them, not scaled to the truth."
COLOURS = "Colours end where 98 % of the values do; grey does not count."
NORMALS = "Normals are in the colours of the ball: red to the right, green up, blue towards the camera."


def about(group: Group) -> str:
    """Sentence on the setting, with the note on phantoms where the data are one."""
    text = f"Data: {group.setting}."
    return f"{text} {PHANTOM}" if group.setting.data == "phantom" else text


def about_training(group: Group) -> str:
    """Sentence on the data of trainings, with the note on phantoms where the data are one."""
    setting = group.setting
    text = f"Data: {setting.data}, split {setting.split}, size {setting.size}."
    return f"{text} {PHANTOM}" if setting.data == "phantom" else text


def about_maps(group: Group, shown: Sequence[Method]) -> str:
    """Last sentences of captions of predicted maps: scaling, colours, seeds, missing methods, data."""
    return sentences(UNSCALED, COLOURS, seeds(shown), missing(shown, group.methods), about(group))


def seeds(methods: Sequence[Method]) -> str:
    """Sentence on the seed of the run that is drawn of each method."""
    by_seed: dict[int, list[str]] = {}
    for method in methods:
        by_seed.setdefault(int(method.shown.summary["seed"]), []).append(method.label)
    if len(by_seed) == 1:
        return f"Predictions of seed {next(iter(by_seed))}."
    return (
        "Predictions of " + "; ".join(f"seed {s}: {', '.join(labels)}" for s, labels in by_seed.items()) + "."
    )


def repeats(methods: Sequence[Method]) -> str:
    """Sentence on how many seeds are pooled."""
    counts = {method.label: len(method.runs) for method in methods}
    if len(set(counts.values())) == 1:
        number = next(iter(counts.values()))
        return "One seed a method." if number == 1 else f"{number} seeds a method, pooled."
    return "Seeds pooled: " + ", ".join(f"{label} {number}" for label, number in counts.items()) + "."


def missing(shown: Iterable[Method], all_of_them: Iterable[Method]) -> str:
    """Sentence on the methods of a table that are not in the figure."""
    labels = {method.label for method in shown}
    absent = [method.label for method in all_of_them if method.label not in labels]
    return f"Not shown: {', '.join(absent)}." if absent else ""


def with_direction(spec: MetricSpec) -> str:
    """A metric's heading, and which way is better."""
    return f"{spec.title} ({spec.better} is better)" if spec.better else spec.title


def sentences(*parts: str) -> str:
    """Join the sentences of a caption that are not empty."""
    return " ".join(part for part in parts if part)
