"""Calls any kernel by its address, so that one compiled loop serves every combination of terms.

numba's first-class functions do the same, but a typed list of them takes 70 us to hand over from Python; an
array of addresses takes none and the call itself is twice as fast.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import cache
from typing import Any

import numpy as np
from llvmlite import ir
from numba import float64
from numba.experimental.function_type import _get_wrapper_address
from numba.extending import intrinsic

from tcs_friction.physics.terms import KERNEL_SIGNATURE, Kernel


def addresses(kernels: Sequence[Kernel]) -> np.ndarray:
    """Entry points of compiled kernels, (k,). The kernels must outlive the array, as those of modules do."""
    return np.array([_address(function) for function in kernels], dtype=np.int64)


@cache
def _address(function: Kernel) -> int:
    """Entry point of one kernel: asking the compiler for it takes its lock, which every thread of a search waits for."""
    return int(_get_wrapper_address(function, KERNEL_SIGNATURE))


@intrinsic
def call_kernel(typing_context: Any, address: Any, motion: Any, parameters: Any, state: Any, dt: Any) -> Any:
    """In compiled code: the kernel at `address` called with the arguments of the one signature."""

    def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        values = [context.get_value_type(kind) for kind in signature.args[1:]]
        function = ir.FunctionType(ir.DoubleType(), values)
        return builder.call(builder.inttoptr(arguments[0], function.as_pointer()), arguments[1:])

    return float64(address, motion, parameters, state, dt), generate
