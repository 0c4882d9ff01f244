"""Functions of a fitted model as its methods; ``model_methods.pyi``, written by scripts/interface.py, has their signatures."""

from __future__ import annotations

from collections.abc import Callable
from types import MethodType
from typing import Any

from stoop.base.packages import places, resolved


class _Method:
    """A function as a method; its module is imported at the first use."""

    def __init__(self, place: str) -> None:
        self.place = place

    def __get__(self, model: object | None, owner: type) -> Callable[..., Any]:
        function: Callable[..., Any] = resolved(self.place)
        return function if model is None else MethodType(function, model)


class ModelMethods:
    """The methods of a fitted model that are functions of a package."""


def add_methods(model: type) -> None:
    """Give a class the methods of stoop and of packages; names that it has stay its own."""
    own = [*dir(model), *getattr(model, "__dataclass_fields__", ())]
    for name, place in places("methods", own).items():
        setattr(model, name, _Method(place))
