"""Kernels read from the cache ahead of need, for a process that others are forked from: none of these reads them again.

A process that plans a program reads some sixty kernels, 15 ms each.
"""

from __future__ import annotations

import os
import sys
from typing import Any

from counterflex.core.compiled import with_records
from counterflex.core.jit import Kernel


def read_compiled(kernels: list[Any] | None = None) -> None:
    """Read kernels that are in the cache and have not been read; compile none.

    Args:
        kernels: Which ones; None: :func:`all_kernels`.
    """
    for kernel in all_kernels() if kernels is None else kernels:
        if kernel._stated and _is_cached(kernel):
            kernel.compile_stated()


def read_before_forks() -> None:
    """Have this process do so before each fork: what has been compiled meanwhile is read once."""
    server, kernels = os.getpid(), all_kernels()

    def before() -> None:
        if os.getpid() == server:
            read_compiled(kernels)

    os.register_at_fork(before=before)


def all_kernels() -> list[Any]:
    """Kernels of the modules imported so far that state their signatures.

    Left out are those that start threads when they are read: threads do not survive a fork.
    """
    modules = [module for name, module in list(sys.modules.items()) if name.startswith("counterflex.")]
    found = {id(item): item for module in modules for item in vars(module).values() if isinstance(item, Kernel)}
    return [kernel for kernel in found.values() if kernel._stated and not kernel.targetoptions.get("parallel")]


def _is_cached(kernel: Any) -> bool:
    stored = kernel._cache._cache_file._load_index()
    if not stored:
        return False
    codegen, records = kernel.targetctx.codegen(), kernel._records
    signatures = [with_records(one, records) if records else one for one in kernel._stated]
    return all(kernel._cache._index_key(one, codegen) in stored for one in signatures)
