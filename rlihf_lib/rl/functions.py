"""Observers and rewards given from outside: what identifies them.

A reader may hand a function of their own to a run. It travels to the workers with the config, and
the hash of its source, and of whatever it refers to, becomes part of the run's.
"""

import inspect
import textwrap
from types import FunctionType, ModuleType

from rlihf_lib.files import canonical_json, sha256

_PLAIN = (int, float, str, bool, type(None), tuple)


def describe(function):
    """Identify a function by name and source.

    Parameters
    ----------
    function : callable
        Defined with `def` or `lambda`, in a file or a notebook cell. What it refers to may be
        numbers, strings, tuples, modules, installed code or such functions again.

    Returns
    -------
    dict
        Keys name and sha256.

    Raises
    ------
    ValueError
        If it refers to something whose value can't be written down, or its source is not known.
    """
    name = getattr(function, "__name__", "function").strip("<>")
    return {"name": name, "sha256": sha256(canonical_json(_parts(function, set())))}


def _parts(function, seen):
    """List the source of a function and of what it refers to."""
    seen.add(function)
    try:
        parts = [textwrap.dedent(inspect.getsource(function))]
        # Defaults are part of the source, but the values behind their names aren't.
        referred = inspect.getclosurevars(function)
    except (OSError, TypeError) as error:
        raise ValueError(
            f"the source of {function!r} can't be read; give a function defined with def in a file "
            "or a notebook cell"
        ) from error
    defaults = {f"default {i}": value for i, value in enumerate(function.__defaults__ or ())}
    defaults |= function.__kwdefaults__ or {}
    for name, value in sorted({**referred.globals, **referred.nonlocals, **defaults}.items()):
        if isinstance(value, FunctionType) and not _installed(value):
            if value not in seen:
                parts.append([name, _parts(value, seen)])
        elif isinstance(value, _PLAIN):
            parts.append([name, repr(value)])
        elif isinstance(value, ModuleType) or _installed(value):
            parts.append([name, getattr(value, "__name__", type(value).__name__)])
        else:
            raise ValueError(
                f"{function.__name__} refers to {name}, a {type(value).__name__}; "
                "use numbers, strings, tuples or functions, so that its value can be recorded"
            )
    return parts


def _installed(value):
    """Tell whether a function or class comes with the library or an installed package."""
    module = inspect.getmodule(value)
    path = getattr(module, "__file__", None) or ""
    library = getattr(module, "__name__", "").split(".")[0] == "rlihf_lib"
    return (
        library
        or "site-packages" in path
        or (module is not None and not path and module.__name__ != "__main__")
    )
