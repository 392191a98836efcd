"""Calls any kernel by its address, so that one compiled loop serves every combination of terms.

numba's first-class functions do the same, but a typed list of them takes 70 us to hand over from Python, where an array of
addresses takes none. They also pass through a wrapper for callers in C, which repacks all arguments. A kernel raises nothing, so
its status is not asked for.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import cache
from typing import Any

import numpy as np
from numba import float64
from numba.extending import intrinsic

from tcs_friction.physics.terms import KERNEL_SIGNATURE, Kernel


def addresses(kernels: Sequence[Kernel]) -> np.ndarray:
    """Entry points of compiled kernels, (k,). The kernels must outlive the array, as those of modules do."""
    return np.array([_address(function) for function in kernels], dtype=np.int64)


@cache
def _address(function: Any) -> int:
    """Entry point of one kernel: asking the compiler for it takes its lock, which every thread of a search waits for."""
    compiled = function.get_compile_result(KERNEL_SIGNATURE)
    return int(compiled.library.get_pointer_to_function(compiled.fndesc.llvm_func_name))


@intrinsic
def call_kernel(typing_context: Any, address: Any, motion: Any, parameters: Any, state: Any, dt: Any) -> Any:
    """In compiled code: the kernel at `address` called with the arguments of the one signature."""

    def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        result, kinds = signature.return_type, signature.args[1:]
        function = context.call_conv.get_function_type(result, kinds)
        entry = builder.inttoptr(arguments[0], function.as_pointer())
        _status, returned = context.call_conv.call_function(builder, entry, result, kinds, arguments[1:])
        return returned

    return float64(address, motion, parameters, state, dt), generate
