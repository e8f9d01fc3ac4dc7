"""Compiled entry points called by their address from another kernel.

A kernel that calls another one has a copy of its code, compiled once more with its own: a minute for the cycle of the
online loop. One that is called by address is compiled once, for whoever calls it::

    run_cycle = at_address(cycle)

    @kernel("void(int64, Loop[::1], Arrays[::1])", Loop=LOOP, Arrays=ARRAYS)
    def work(address: int, loops: Records, tables: Records) -> None:
        run_cycle(address, loops, tables)

    work(address_of(cycle), loops, tables)
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numba
from numba import types
from numba.core import cgutils
from numba.extending import intrinsic

from counterflex.core.compiled import with_records


def address_of(function: Any) -> int:
    """Return where the code of a kernel with one signature lies, compiled or read if it is not yet; 0: it has none."""
    if numba.config.DISABLE_JIT:
        return 0
    function.compile_stated()
    (result,) = function.overloads.values()
    return int(result.library.get_pointer_to_function(result.fndesc.llvm_func_name))


def at_address(function: Any) -> Any:
    """Return what a kernel calls with the address of another one, then its arguments.

    Args:
        function: Kernel with one signature.
    """
    if numba.config.DISABLE_JIT:
        return lambda _address, *arguments: function(*arguments)
    return at_address_of(*function.stated)


def at_address_of(stated: str, records: dict[str, Any]) -> Any:
    """As :func:`at_address`, for any kernel of a signature: who calls it does not know whose it is.

    Args:
        stated: The signature.
        records: Types by the names that it gives them.
    """
    if numba.config.DISABLE_JIT:
        return lambda _address, *_: 0  # such a kernel has no address then, and nobody calls it
    signature = with_records(stated, records)
    result, lower = signature.return_type, _lowering(signature.return_type, signature.args)

    @intrinsic  # type: ignore[untyped-decorator]
    def call(_context: Any, _address: Any, *arguments: Any) -> Any:
        """Call what lies there."""
        return result(types.int64, types.StarArgTuple.from_types(arguments)), lower

    return call


def _lowering(result: Any, kinds: tuple[Any, ...]) -> Callable[..., Any]:
    """Code that calls a kernel of these types, as Numba calls one."""

    def lower(context: Any, builder: Any, own: Any, values: Any) -> Any:
        pairs = zip(own.args[1].types, kinds, strict=True)
        given = [
            context.cast(builder, builder.extract_value(values[1], k), kind, required)
            for k, (kind, required) in enumerate(pairs)
        ]
        code = builder.inttoptr(values[0], context.call_conv.get_function_type(result, kinds).as_pointer())
        status, out = context.call_conv.call_function(builder, code, result, kinds, given)
        with cgutils.if_unlikely(builder, status.is_error):
            context.call_conv.return_status_propagate(builder, status)
        return context.get_dummy_value() if result == types.void else out

    return lower
