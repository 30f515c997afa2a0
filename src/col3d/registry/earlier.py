"""Conversion of options that earlier versions wrote to the current names and structure."""

from typing import Any

TERMS = {
    "depth": {"silog": "silog", "rmse_log": "rmse_log", "l1": "depth_l1"},
    "gradients": {"l1": "gradient_l1"},
    "directions": {"cosine": "gradient_direction"},
    "normals": {"l1": "normal_l1", "l2": "normal_rmse"},
    "consistency": {"rmse": "cross_task_rmse", "l1": "cross_task_l1"},
}
"""Terms that the values of a loss without named terms stand for, in the order of its lambdas."""

WITHOUT_RELEASE = ("simcol3d", "folder")
"""Data sets with one release, whose option `release` is dropped."""

NAMES = {"house": "standard"}
"""Old names of choices and their current ones: protocols, axes of normals, heads."""

ADDED: dict[str, Any] = {
    "model.heads": "standard",
    "model.pyramid_norm": "group",
    **{
        f"optimizer.{name}": False
        for name in ("amsgrad", "maximize", "capturable", "differentiable", "nesterov")
    },
    "optimizer.dampening": 0,
    "trainer.num_nodes": 1,
}
"""Options that a run may lack, with the value that such runs implicitly used."""


def updated(options: dict[str, Any]) -> dict[str, Any]:
    """Convert options of a run to the form that `train.py` writes.

    Args:
        options: from `config.yaml` or a checkpoint of any version; what is not understood is left unchanged.

    >>> updated({"loss": {"depth": "silog", "normals": "l2", "lambdas": [0.5, 0.5]}})["loss"]["terms"]
    {'depth': {'term': 'silog', 'from_epoch': 0}, 'normals': {'term': 'normal_rmse', 'from_epoch': 0}}
    """
    if isinstance(data := options.get("data"), dict):
        options = {**options, "data": _data(data)}
    if isinstance(model := options.get("model"), dict) and model.get("heads") in NAMES:
        options = {**options, "model": {**model, "heads": NAMES[model["heads"]]}}
    if isinstance(protocols := options.get("protocol"), dict):
        options = {**options, "protocol": _protocols(protocols)}
    options = _with_loggers(options)
    loss = options.get("loss")
    if not isinstance(loss, dict) or "terms" in loss or not isinstance(loss.get("depth"), str):
        return options
    terms: dict[str, dict[str, Any]] = {
        name: {"term": known.get(str(loss[name]), loss[name]), "from_epoch": 0}
        for name, known in TERMS.items()
        if loss.get(name) is not None
    }
    if "consistency" in terms:
        terms["consistency"]["geometry"] = loss.get("geometry") or "rays"
    for name, epoch in zip(terms, loss.get("from_epoch") or (), strict=False):
        terms[name]["from_epoch"] = epoch
    return {**options, "loss": {"lambdas": loss.get("lambdas"), "terms": terms}}


def _protocols(given: dict[str, Any]) -> dict[str, Any]:
    """Rename protocols and their choices to the current names.

    >>> _protocols({"house": {"normal_axes": "house", "scaling": "none"}})
    {'standard': {'normal_axes': 'standard', 'scaling': 'none'}}
    """
    return {
        NAMES.get(name, name): {key: NAMES.get(str(value), value) for key, value in own.items()}
        if isinstance(own, dict)
        else own
        for name, own in given.items()
    }


def _data(options: dict[str, Any]) -> dict[str, Any]:
    """Drop options that a data set lacks and that hold their default, also in `test` and `also`."""
    also = options.get("also")
    inside = {name: _data(source) for name, source in also.items()} if isinstance(also, dict) else also
    test = options.get("test")
    now = {**options, "test": _data(test) if isinstance(test, dict) else test, "also": inside}
    needless: dict[str, Any] = {"layout": None, "randomise": False}
    if options.get("name") in WITHOUT_RELEASE:
        needless["release"] = "auto"
    return {
        name: value
        for name, value in now.items()
        if name in options and (name not in needless or value != needless[name])
    }


def _with_loggers(options: dict[str, Any]) -> dict[str, Any]:
    """Convert a single logger, given by its option `name`, to a mapping of loggers by name.

    >>> _with_loggers({"logger": {"name": "wandb", "project": "p", "offline": True}})
    {'logger': {'wandb': {'project': 'p', 'offline': True}}}
    """
    logger = options.get("logger")
    if not isinstance(logger, dict) or not isinstance(logger.get("name"), str):
        return options
    own = {name: value for name, value in logger.items() if name != "name"}
    return {**options, "logger": {"wandb": own} if logger["name"] == "wandb" else {}}
