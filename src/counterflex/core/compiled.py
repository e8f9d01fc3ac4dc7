"""Compile, keep and read the code of a kernel with Numba; loads the compiler, which takes a quarter of a second.

:mod:`counterflex.core.jit` imports this when a kernel is first called.
"""

from __future__ import annotations

import contextlib
import enum
import functools
import sys
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numba
import numpy as np
from numba.core.caching import CompileResultCacheImpl, FunctionCache, NullCache, UserProvidedCacheLocator
from numba.core.compiler_lock import global_compiler_lock
from numba.core.registry import CPUDispatcher
from numba.np import arrayobj

from counterflex.core import shipped

if sys.platform != "win32":
    import fcntl

_record_type = functools.cache(numba.from_dtype)


def _wrong_size(_src_shapes: Any, _index_shape: Any) -> None:
    """Raise in a kernel that a slice is assigned an array of another shape."""


@numba.extending.overload(_wrong_size)  # type: ignore[untyped-decorator]
def _compiled_wrong_size(_src_shapes: Any, _index_shape: Any) -> Any:
    def impl(_src_shapes: Any, _index_shape: Any) -> None:
        raise ValueError("cannot assign slice from input of different size")

    return impl


# Numba's own message names both shapes. The code that makes a text of them went into every kernel that assigns to a
# slice, and took up to two fifths of the time of compiling it.
arrayobj.raise_with_shape_context = _wrong_size


def numba_type(kind: Any) -> Any:
    """Return the type that a kernel takes.

    Args:
        kind: Record dtype; ``(dtype,)`` for an array of records of one dimension; text as a signature has it; or a
            NamedTuple type with the kinds of its fields (:func:`counterflex.core.jit.bundle`).
    """
    if isinstance(kind, np.dtype):
        return _record_type(kind)
    if isinstance(kind, str):
        return eval(kind, vars(numba.types))
    if isinstance(kind, tuple):
        return _record_type(kind[0])[::1]
    return kind.numba_type(numba_type, numba.types.NamedTuple)


def with_records(signature: str, records: dict[str, Any]) -> Any:
    """Return a signature in which the names of records and bundles stand for their types."""
    types = {name: numba_type(kind) for name, kind in records.items() if name in signature}
    return eval(signature, vars(numba.types) | types)


@contextlib.contextmanager
def _alone(file: Path) -> Iterator[None]:
    """Wait until no other process holds a lock file, then hold it; a place without locks is no obstacle."""
    try:
        file.parent.mkdir(parents=True, exist_ok=True)
        lock = file.open("w")
    except OSError:
        yield
        return
    with lock:
        if sys.platform != "win32":
            with contextlib.suppress(OSError):
                fcntl.flock(lock, fcntl.LOCK_EX)
        yield


class _BySources(UserProvidedCacheLocator):  # type: ignore[misc]
    """Place of a function's compiled code: the folder named after its sources, wherever these are installed.

    Numba adds a folder named after the path of the source file: a second installation would compile everything again.
    """

    @classmethod
    def get_suitable_cache_subpath(cls, py_file: str) -> str:  # noqa: ARG003
        return ""

    def get_source_stamp(self) -> int:
        return 0  # the name of the folder says which sources; a copied file has another time


class _InPackage(_BySources):
    """Place of code that came with the package: only read."""

    def ensure_cache_path(self) -> None:
        pass


class _Code(CompileResultCacheImpl):  # type: ignore[misc]
    """Numba's way to write and read compiled code, in that place."""

    _locator_classes: tuple[type, ...] = (_BySources,)  # Numba's other places are not proven to be this user's alone


class _ShippedCode(_Code):
    _locator_classes = (_InPackage,)


class _ShippedCache(FunctionCache):  # type: ignore[misc]
    """Code of one function that came with the package, for another processor than this one, which can run it."""

    _impl_class = _ShippedCode

    def __init__(self, function: Callable[..., Any], what: shipped.Shipped) -> None:
        super().__init__(function)
        self._target = what.target

    def _index_key(self, sig: Any, codegen: Any) -> Any:
        signature, _, function = super()._index_key(sig, codegen)
        return signature, self._target, function

    def load_overload(self, sig: Any, target_context: Any) -> Any:
        return super().load_overload(sig, target_context) if self.is_as_listed() else None

    def is_as_listed(self) -> bool:
        """Return whether its files are those that the package lists."""
        return all(map(shipped.is_listed, Path(self.cache_path).glob(f"{self._impl.filename_base}.*")))


class _SharedCache(FunctionCache):  # type: ignore[misc]
    """Numba's cache of one function, asked again when no other process is compiling that function any more."""

    _impl_class = _Code

    def __init__(self, function: Callable[..., Any], folder: Path | None) -> None:
        super().__init__(function)
        self.shipped: _ShippedCache | None = None
        what = shipped.listed()
        if folder is not None and what is not None:
            numba.config.CACHE_DIR = str(folder)
            self.shipped = _ShippedCache(function, what)
        self._name_of_lock = f"{function.__qualname__}-{function.__code__.co_firstlineno}.lock"
        self.locks: contextlib.ExitStack | None = None

    def load_overload(self, sig: Any, target_context: Any) -> Any:
        result = self._loaded(sig, target_context)
        if result is None and self.shipped is not None:
            result = self.shipped.load_overload(sig, target_context)
        if result is None and self.locks is not None:
            self.locks.enter_context(_alone(Path(self.cache_path) / self._name_of_lock))
            result = self._loaded(sig, target_context)
        return result

    def _loaded(self, sig: Any, target_context: Any) -> Any:
        """Read compiled code; a file that a power failure cut off is as good as none, and is written anew."""
        try:
            return super().load_overload(sig, target_context)
        except Exception:  # unpickling raises anything
            with contextlib.suppress(OSError):
                self.flush()
            return None

    def save_overload(self, sig: Any, data: Any) -> None:
        with contextlib.suppress(OSError):  # a full disk: what cannot be kept is compiled again next time
            super().save_overload(sig, data)


class _NoCache(NullCache):  # type: ignore[misc]
    """Used where compiled code cannot be kept: the disk is full."""

    locks: contextlib.ExitStack | None = None


def _lists(cache: FunctionCache, signatures: list[Any], codegen: Any) -> bool:
    """Return whether the index of a cache names the code of all signatures; one that is cut off names none."""
    try:
        index = cache._cache_file._load_index()
    except Exception:  # unpickling raises anything
        return False
    return all(cache._index_key(one, codegen) in index for one in signatures)


class CodeCache(enum.StrEnum):
    """Place of compiled code: this user's, for this processor; the package's, for a baseline one; nowhere."""

    NATIVE = "native"
    SHIPPED = "shipped"
    MISSING = "missing"


class Dispatcher(CPUDispatcher):  # type: ignore[misc]
    """A compiled function that is compiled for the stated signatures when it is first needed, and for no other type."""

    _only_stated = False
    _stated: tuple[Any, ...] = ()
    _records: dict[str, Any]

    def state(self, signatures: tuple[Any, ...], records: dict[str, Any]) -> None:
        """State the only signatures that it will ever have; their names are looked up when they are needed."""
        self._only_stated, self._stated, self._records = True, signatures, records

    def keep(self, folder: Path, in_package: Path | None) -> None:
        """Take the cache by sources, or none where Numba finds no place for it.

        Args:
            folder: Of compiled code of this user.
            in_package: Of that which came with the package, or None.
        """
        numba.config.CACHE_DIR = str(folder)
        try:
            self._cache = _SharedCache(self.py_func, in_package)
        except RuntimeError:
            self._cache = _NoCache()

    def kept(self) -> CodeCache:
        """Return the place of the code of all stated signatures."""
        if not isinstance(self._cache, _SharedCache):
            return CodeCache.MISSING
        required = [with_records(one, self._records) if self._records else one for one in self._stated]
        own, brought = self._cache, self._cache.shipped
        if _lists(own, required, self.targetctx.codegen()):
            return CodeCache.NATIVE
        if brought is not None and brought.is_as_listed() and _lists(brought, required, self.targetctx.codegen()):
            return CodeCache.SHIPPED
        return CodeCache.MISSING

    def compile(self, sig: Any) -> Any:
        """Compile for a signature, while no other process compiles the same."""
        with global_compiler_lock, contextlib.ExitStack() as locks:
            before, self._cache.locks = self._cache.locks, locks
            try:
                return super().compile(sig)
            finally:
                self._cache.locks = before

    def compile_stated(self) -> None:
        """Compile it for its stated signatures or read it from the cache, unless that is done."""
        with global_compiler_lock:
            stated, self._stated = self._stated, ()
            try:
                for signature in stated:
                    self.compile(with_records(signature, self._records) if self._records else signature)
            except BaseException:
                self._stated = stated
                raise
            if stated:
                self.disable_compile()

    def _compile_for_args(self, *args: Any, **kws: Any) -> Any:
        if self._only_stated:
            self.compile_stated()  # by one thread: others that call it meanwhile wait here
            return self  # is called again, and now finds its signature or raises TypeError
        return super()._compile_for_args(*args, **kws)

    def get_call_template(self, args: Any, kws: Any) -> Any:
        """Return the signature for a call from another kernel."""
        self.compile_stated()
        return super().get_call_template(args, kws)

    def _reduce_states(self) -> Any:
        self.compile_stated()
        return super()._reduce_states()


def _set_disjoint(flags: Any) -> Any:
    flags.noalias = True
    return flags


def dispatcher(
    function: Callable[..., Any],
    options: dict[str, Any],
    signatures: tuple[Any, ...] | None,
    records: dict[str, Any],
    folder: Path,
    in_package: Path | None,
) -> Dispatcher:
    """Return the compiled function of a kernel; nothing is compiled yet. The caller holds the lock of the compiler.

    Args:
        signatures: The only ones that it will have, or None.
        records: Types by the names that signatures give them.
    """
    disjoint = options.pop("noalias", False)
    compiled = Dispatcher(function, targetoptions=options)
    if disjoint:  # Numba sets this flag for its own parallel loops only and has no option for it
        compiled._compiler._customize_flags = _set_disjoint
    compiled.keep(folder, in_package)
    if signatures is not None:
        compiled.state(signatures, records)
    return compiled
