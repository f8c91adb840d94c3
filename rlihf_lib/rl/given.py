"""Observers, rewards and feedback given from outside: what identifies them.

A reader may hand a function of their own to a run. It travels to the workers with the config, and
the hash of its source, and of whatever it refers to, becomes part of the run's.
"""

import dis
import inspect
import sys
import sysconfig
import textwrap
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from types import CodeType, FunctionType, ModuleType

import numpy as np

from rlihf_lib.files import canonical_json, sha256

LIBRARY = Path(__file__).resolve().parents[1]
INSTALLED = tuple(sysconfig.get_path(name) for name in ("stdlib", "purelib", "platlib"))


@dataclass(frozen=True)
class Given:
    """A function from outside, with the hash of its source and of what it refers to."""

    name: str
    sha256: str
    function: Callable = field(compare=False, repr=False)

    def __call__(self, *told):
        """Call the function."""
        return self.function(*told)


def given(function: Callable) -> Given:
    """Identify a function by name and source, defined in a file or a notebook cell.

    It may refer to numbers, strings, tuples, modules, installed code or such functions again; a
    ValueError if to something else, whose value can't be written down, or without its source.
    """
    name = getattr(function, "__name__", type(function).__name__).strip("<>")
    return Given(name, sha256(canonical_json(_parts(function, name, set()))), function)


def _parts(function, name, seen):
    seen.add(function)
    try:
        parts: list = [textwrap.dedent(inspect.getsource(function))]
        enclosed = inspect.getclosurevars(function).nonlocals
    except (OSError, TypeError) as error:
        raise ValueError(
            f"the source of {name} can't be read; give a function defined with def in a file or a "
            "notebook cell"
        ) from error
    defaults = {f"default {i}": value for i, value in enumerate(function.__defaults__ or ())}
    defaults |= function.__kwdefaults__ or {}
    known = function.__globals__
    values = {n: known[n] for n in _globals_of(function.__code__) if n in known}
    for key, value in sorted({**values, **enclosed, **defaults}.items()):
        if isinstance(value, ModuleType | np.ufunc):
            parts.append([key, value.__name__])
        elif callable(value) and _comes_with_the_library(value):
            parts.append([key, value.__qualname__])
        elif isinstance(value, FunctionType):
            parts += [] if value in seen else [[key, _parts(value, key, seen)]]
        elif _is_plain(value):
            parts.append([key, repr(value)])
        else:
            raise ValueError(
                f"{name} refers to {key}, a {type(value).__name__}; use numbers, strings, tuples "
                "or functions, so that its value can be recorded"
            )
    return parts


def _globals_of(code: CodeType) -> set[str]:
    """Name the globals that code reads, also in the functions and comprehensions in it."""
    names = {step.argval for step in dis.get_instructions(code) if step.opname == "LOAD_GLOBAL"}
    inner = [constant for constant in code.co_consts if isinstance(constant, CodeType)]
    return names.union(*map(_globals_of, inner))


def _is_plain(value):
    if isinstance(value, tuple):
        return all(map(_is_plain, value))
    return isinstance(value, (int, float, str, bool, type(None)))


def _comes_with_the_library(value):
    """Tell whether code is this library's, which `PROTOCOL` covers, or an installed package's."""
    module = getattr(value, "__module__", None) or ""
    path = getattr(sys.modules.get(module), "__file__", None) or ""
    is_known = LIBRARY in Path(path).parents or path.startswith(INSTALLED)
    return hasattr(value, "__qualname__") and (is_known or module in sys.builtin_module_names)
