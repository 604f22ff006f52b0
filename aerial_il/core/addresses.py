"""Calls from compiled code through addresses: what is called so is compiled by itself, and its caller only once."""

from typing import Any

import llvmlite.ir as ir
import numba
import numpy as np
from numba import extending, types

intrinsic: Any = extending.intrinsic  # typed so, since what it makes is called without its first argument
_NUMBERS = numba.from_dtype(np.dtype([("first", np.float64)]))  # stands for records of which only the address matters


def read_at(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
    """Emit code that takes an address (integer) for what the signature returns, a record or a pointer."""
    return builder.inttoptr(arguments[0], context.get_value_type(signature.return_type))


def called(result: types.Type, *given: types.Type) -> Any:
    """Return what emits a call of the C function at the first argument with the others, of the types ``given``."""

    def emit(context: Any, builder: Any, _: Any, arguments: Any) -> Any:
        nothing = result == types.void
        kinds = [context.get_value_type(kind) for kind in given]
        function = ir.FunctionType(ir.VoidType() if nothing else context.get_value_type(result), kinds)
        value = builder.call(builder.inttoptr(arguments[0], function.as_pointer()), arguments[1:])
        return context.get_dummy_value() if nothing else value

    return emit


@intrinsic
def numbers_at(_: Any, address: types.Integer) -> Any:
    """Take an address as that of a record that somebody else reads."""
    return _NUMBERS(address), read_at


def record_of_numbers(numbers: dict[str, Any]) -> np.ndarray:
    """Return numbers and arrays by name as one record (1,), which compiled code reads by its address.

    Integers stay integers; without any, one zero is there.
    """
    values = {name: np.asarray(value) for name, value in (numbers or {"none": 0.0}).items()}
    kinds = [(n, np.int64 if v.dtype.kind == "i" else np.float64, v.shape) for n, v in values.items()]
    record = np.zeros(1, np.dtype(kinds, align=True))
    for name, value in values.items():
        record[name][0] = value
    return record
