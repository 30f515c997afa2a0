"""Registration of timm's optimisers by name, except those that torch has as well."""

import fnmatch
from inspect import signature
from typing import Any

import timm.optim

from col3d.registry import register_optimizer
from col3d.training.optimizers import OPTIMIZERS

OF_OTHER_LIBRARIES = ("fused*", "bnb*")

for _name in timm.optim.list_optimizers():
    _info = timm.optim.get_optimizer_info(str(_name))
    _class: Any = _info.opt_class
    _foreign = any(fnmatch.fnmatch(_info.name, pattern) for pattern in OF_OTHER_LIBRARIES)
    if _foreign or _info.second_order or _info.name in OPTIMIZERS.parts:
        continue
    _usual = {"momentum": 0.9} if {"nesterov", "momentum"} <= signature(_class).parameters.keys() else {}
    register_optimizer(_info.name, _class, defaults={**_usual, **(_info.defaults or {})})
