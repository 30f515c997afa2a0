"""Forward passes and training steps beside those of the published code: time and memory."""

from collections.abc import Iterator, Mapping
from functools import partial
from statistics import median

from benchmarks.gpu.networks import OWN_FORMAT, TWIN, Subject, subjects
from benchmarks.gpu.results import Record
from benchmarks.gpu.setting import FLOAT32, MS, Mode, Setting
from benchmarks.networks import batch_of
from benchmarks.timing import Work, interleaved, ratios

GB = 1e9
AIMS = {FLOAT32: 1.3}
"""How many times as fast a step should be as that of the published code in the same precision."""
BEST_AIM = 3.0
"""How many times as fast the fastest step should be as that of the published code in float32."""
MEMORY_AIM = 0.6
Key = tuple[Subject, Mode]
Seconds = Mapping[Key, list[float]]


def speed(setting: Setting, name: str) -> Iterator[Record]:
    """Rows of one network in all its forms and precisions, and what its aims say."""
    found = subjects(setting, name)
    keys = [(subject, mode) for subject in found for mode in modes_of(setting, subject)]
    forward, step = forward_seconds(setting, keys), step_seconds(setting, keys)
    batch = batch_of(setting.batch, setting.side, setting.device)
    held = {(subject, mode): subject.peak_bytes(setting, mode, batch) for subject, mode in keys}
    for subject, mode in keys:
        yield _row(setting, name, (subject, mode), forward, step, held)
    if any(subject.name == TWIN for subject in found):
        yield from _aims(name, step, held)


def modes_of(setting: Setting, subject: Subject) -> tuple[Mode, ...]:
    """All precisions; of a network in the other memory format the fastest alone."""
    return setting.modes if subject.name in (OWN_FORMAT, TWIN) else setting.modes[-1:]


def forward_seconds(setting: Setting, keys: list[Key]) -> Seconds:
    """Of a forward pass in evaluation mode, by round."""
    image = batch_of(setting.batch, setting.side, setting.device)["image"]
    for subject, _ in keys:
        subject.module.eval()
    works = {key: partial(key[0].predict, setting, key[1], image, setting.forwards) for key in keys}
    return _timed(setting, works, setting.forwards)


def step_seconds(setting: Setting, keys: list[Key]) -> Seconds:
    """Of a training step, by round."""
    batch = batch_of(setting.batch, setting.side, setting.device)
    for subject, _ in keys:
        subject.module.train()
    works = {key: partial(key[0].step, setting, key[1], batch, setting.steps) for key in keys}
    return _timed(setting, works, setting.steps)


def _timed(setting: Setting, works: Mapping[Key, Work], in_a_row: int) -> Seconds:
    names = {str(number): key for number, key in enumerate(works)}
    by_name = {number: works[key] for number, key in names.items()}
    seconds = interleaved(by_name, setting.rounds, setting.device)
    return {names[number]: [second / in_a_row for second in taken] for number, taken in seconds.items()}


def _row(
    setting: Setting, name: str, key: Key, forward: Seconds, step: Seconds, held: Mapping[Key, int]
) -> Record:
    subject, mode = key
    row: Record = {"table": f"Speed, {setting.size}", "network": name, "form": subject.name}
    row["precision"] = mode.name
    for column, seconds in (("forward", forward), ("step", step)):
        taken = seconds[key]
        row[f"{column}, ms"] = MS * median(taken)
        row[f"{column}, frames/s"] = setting.batch / median(taken)
        row[f"{column}, least and most of the rounds, ms"] = [MS * min(taken), MS * max(taken)]
    row["memory of a step, GB"] = held[key] / GB
    twin = next((other for other in step if other[0].name == TWIN and other[1] is mode), None)
    if twin is not None and twin != key:
        row["published code / this, forward"] = median(ratios(forward[twin], forward[key]))
        row["published code / this, step"] = median(ratios(step[twin], step[key]))
        row["memory, this / published code"] = held[key] / held[twin]
    return row


def _aims(name: str, step: Seconds, held: Mapping[Key, int]) -> Iterator[Record]:
    twins = {mode: (subject, mode) for subject, mode in step if subject.name == TWIN}
    own = [key for key in step if key[0].name != TWIN]
    table = {"table": "Aims", "network": name}
    for mode, aim in AIMS.items():
        key = next(key for key in own if key[0].name == OWN_FORMAT and key[1] is mode)
        ratio = median(ratios(step[twins[mode]], step[key]))
        text = f"step, published code / col3d, {mode.name}"
        yield {**table, "what": text, "ratio": ratio, "aim": f"at least {aim:g}", "": ratio >= aim}
        share = held[key] / held[twins[mode]]
        text = f"memory of a step, col3d / published code, {mode.name}"
        yield {
            **table,
            "what": text,
            "ratio": share,
            "aim": f"at most {MEMORY_AIM:g}",
            "": share <= MEMORY_AIM,
        }
    best = min(own, key=lambda key: median(step[key]))
    ratio = median(ratios(step[twins[FLOAT32]], step[best]))
    text = f"step, published code in float32 / {best[0].name} in {best[1].name}"
    yield {**table, "what": text, "ratio": ratio, "aim": f"at least {BEST_AIM:g}", "": ratio >= BEST_AIM}
