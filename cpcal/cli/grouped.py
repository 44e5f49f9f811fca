"""Options of a command as the fields of a dataclass: `Annotated[type, typer.Option(...)] = default`."""

from __future__ import annotations

import inspect
from collections.abc import Callable
from dataclasses import MISSING, fields
from functools import wraps
from typing import Any, TypeVar, get_type_hints

T = TypeVar("T")


def grouped(options: type[Any], parameter: str = "options") -> Callable[[Callable[..., T]], Callable[..., T]]:
    """A command with a parameter that is such a dataclass takes its fields as options of the command line."""

    def decorate(command: Callable[..., T]) -> Callable[..., T]:
        hints = get_type_hints(options, include_extras=True)
        known = inspect.signature(command, eval_str=True).parameters.values()
        own = [one for one in known if one.name != parameter]
        names = [field.name for field in fields(options)]
        added = [
            inspect.Parameter(
                field.name,
                inspect.Parameter.KEYWORD_ONLY,
                default=inspect.Parameter.empty if field.default is MISSING else field.default,
                annotation=hints[field.name],
            )
            for field in fields(options)
        ]

        @wraps(command)
        def run(**given: Any) -> T:
            chosen = options(**{name: given.pop(name) for name in names})
            return command(**given, **{parameter: chosen})

        del run.__wrapped__  # or its signature would count
        run.__signature__ = inspect.Signature([*own, *added])  # type: ignore[attr-defined]
        run.__annotations__ = {parameter.name: parameter.annotation for parameter in (*own, *added)}
        return run

    return decorate
