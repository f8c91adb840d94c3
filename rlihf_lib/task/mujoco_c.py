"""MuJoCo's C functions for code that Numba compiles; names and arguments as in its API reference.

Called from Python, most of them cost more than they take themselves. Models and data are passed by
address: `model._address`, `data._address`.
"""

from pathlib import Path

import llvmlite.binding
import mujoco
from numba import types

# Already loaded by Python's mujoco; this makes its functions known to Numba's compiler.
(_library,) = (
    path
    for pattern in ("libmujoco.so*", "libmujoco*.dylib", "mujoco.dll")
    for path in Path(mujoco.__file__).parent.glob(pattern)
)
llvmlite.binding.load_library_permanently(str(_library))

_OBJECT, _NUMBERS = types.intp, types.CPointer(types.float64)


def _function(name, result, *arguments):
    return types.ExternalFunction(name, result(_OBJECT, *arguments))


mj_step = _function("mj_step", types.void, _OBJECT)
mj_kinematics = _function("mj_kinematics", types.void, _OBJECT)
mj_comPos = _function("mj_comPos", types.void, _OBJECT)
mj_fullM = _function("mj_fullM", types.void, _NUMBERS, _NUMBERS)
mj_jacSite = _function("mj_jacSite", types.void, _OBJECT, _NUMBERS, _NUMBERS, types.int32)
mj_geomDistance = _function(
    "mj_geomDistance", types.float64, _OBJECT, types.int32, types.int32, types.float64, types.intp
)
