"""Compiled kernels: one decorator that keeps types for the checker and a cache that cannot go stale.

Numba's on-disk cache does not see changes in other source files, and it needs a writable place. Each kernel is
therefore cached in a folder named after a hash of its module and of every kernel module that this one imports, in the
user's own folder (:mod:`counterflex.core.user_folder`): compiled code is executed when it is read. Where that folder
cannot be written, code is kept as long as the process. Processes that need the same kernel at the same
time compile it once: one compiles, the others wait and read it.

A wheel brings the code of its kernels, compiled for a baseline processor (:mod:`counterflex.core.shipped`). It is read
where this user has none compiled for the own processor, from the same name: a package, a Python or a Numba that it was
not made for has no folder there.

Nothing is compiled or read when a module is imported, and Numba itself is loaded with the first call of a kernel. A
kernel that states its signatures is compiled for them, and for nothing else, when it is first called or called by a
kernel that is being compiled; :func:`compile_stated` does it before, where a first call must not wait: the online loop.
It does so for entry points only, the kernels that Python calls: the code of what these call is part of theirs.
Set ``NUMBA_DISABLE_JIT=1`` to step through kernels in plain Python.
"""

from __future__ import annotations

import atexit
import contextlib
import functools
import hashlib
import importlib.metadata
import os
import re
import shutil
import sys
import tempfile
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final, TypeVar, cast, get_type_hints

F = TypeVar("F", bound=Callable[..., Any])

COMPILES: Final = os.environ.get("NUMBA_DISABLE_JIT", "0") in ("", "0")
"""Kernels are compiled; otherwise they are plain functions, to step through."""

_PACKAGE = Path(__file__).resolve().parents[1]
_IMPORT = re.compile(rb"^from counterflex((?:\.\w+)*) import (?:\(([^)]*)\)|([^\n(]+))", re.MULTILINE)


@functools.cache
def _source(name: str) -> bytes | None:
    """Text of a module, dotted name below the package; None where there is none."""
    file = _PACKAGE / (name.replace(".", "/") + ".py")
    return file.read_bytes() if file.is_file() else None


@functools.cache
def _imported(name: str) -> frozenset[str]:
    """Dotted names below the package that a module may import as modules."""
    results = set()
    for match in _IMPORT.finditer(_source(name) or b""):
        base = match.group(1).decode().lstrip(".")
        results.add(base)
        for name in (match.group(2) or match.group(3)).decode().replace("\n", " ").split(","):
            word = name.split(" as ")[0].strip()
            if word:
                results.add(f"{base}.{word}".lstrip("."))
    return frozenset(results)


@functools.cache
def _closure(module: str) -> frozenset[str]:
    """Kernel modules that a module's kernels can depend on, itself included (dotted names below the package)."""
    todo, seen = [module], set()
    while todo:
        name = todo.pop()
        if name in seen or _source(name) is None:
            continue
        seen.add(name)
        todo.extend(_imported(name) - seen)
    return frozenset(seen)


@functools.cache
def _cache_root() -> Path:
    """Folder of compiled kernels: this user's, or one of this process alone where that cannot be written."""
    from counterflex.core.user_folder import SharedFolderError, made_own, user_folder  # no kernel depends on it

    try:
        root = made_own(user_folder())
        with tempfile.TemporaryFile(dir=root):
            return root
    except SharedFolderError:
        raise
    except OSError:
        private = tempfile.mkdtemp(prefix="counterflex-kernels-")  # mode 0700, a name that nobody can foresee
        atexit.register(shutil.rmtree, private, ignore_errors=True)
        return Path(private)


@functools.cache
def folder_name(module: str) -> str:
    """Name of the folder for the compiled kernels of a module: of the module, and of all sources they depend on.

    Args:
        module: Full dotted name, for example ``counterflex.plan.cut_kernel``.
    """
    name = module.removeprefix("counterflex.")
    digest = hashlib.sha256(f"{importlib.metadata.version('numba')} {sys.version_info[:2]}".encode())
    for dependency in sorted(_closure(name)):
        digest.update(dependency.encode())
        digest.update(_source(dependency) or b"")
    return f"{name}-{digest.hexdigest()[:16]}"


def cache_folder(module: str) -> Path:
    """This user's folder for the compiled kernels of a module."""
    return _cache_root() / folder_name(module)


@dataclass(frozen=True)
class Bundle:
    """A NamedTuple of arrays and numbers that a kernel takes."""

    kind: type
    fields: tuple[Any, ...]  # Kinds of its fields, in order

    def numba_type(self, of: Callable[[Any], Any], tuple_of: Callable[[list[Any], type], Any]) -> Any:
        """Return its type.

        Args:
            tuple_of: Returns the type of a NamedTuple with fields of some types.
        """
        return tuple_of([of(field) for field in self.fields], self.kind)


def bundle(kind: type) -> Bundle:
    """Return the type of a NamedTuple of arrays and numbers, for a kernel that takes one.

    Args:
        kind: The NamedTuple. Its fields are numbers, ``Annotated`` arrays with their type as a signature writes it
            (``"float64[:, ::1]"``), or with ``(DTYPE,)`` for records of one dimension, and other such NamedTuples.
    """
    return Bundle(kind, tuple(_field(hint) for hint in get_type_hints(kind, include_extras=True).values()))


def _field(hint: Any) -> Any:
    numbers = {float: "float64", int: "int64"}
    return numbers[hint] if hint in numbers else hint.__metadata__[0] if hasattr(hint, "__metadata__") else bundle(hint)


class Kernel:
    """A pure function that is compiled when it is first needed; the compiler is loaded then.

    Everything else that it is asked for is asked of Numba's dispatcher: signatures, options, type.

    Attributes:
        states: It has stated signatures and no others.
        plain: Kernels that are not compiled yet run as they are written.
    """

    plain = False
    # A call goes through this slot to the dispatcher itself, once there is one: a method of Python took 0.4 us of it.
    __slots__ = ("__call__", "__dict__", "__weakref__")
    __call__: Callable[..., Any]

    def __init__(
        self,
        function: Callable[..., Any],
        options: dict[str, Any],
        signatures: tuple[Any, ...] | None,
        records: dict[str, Any],
    ) -> None:
        functools.update_wrapper(self, function)
        self.py_func, self.states = function, signatures is not None
        self._made: Any = None
        self.__call__ = self._first_call
        self._making = (function, options, signatures, records)

    def _dispatcher(self) -> Any:
        """Numba's dispatcher, made by the first thread that needs it."""
        from numba.core.compiler_lock import global_compiler_lock

        from counterflex.core import shipped
        from counterflex.core.compiled import dispatcher

        with global_compiler_lock:  # a second lock could be taken in the other order by a thread that compiles
            if self._made is None:
                module = self.py_func.__module__
                self._made = dispatcher(*self._making, cache_folder(module), shipped.folder(folder_name(module)))
                self.__call__ = self._made
        return self._made

    def _first_call(self, *args: Any, **kws: Any) -> Any:
        """Run it: compiled, or as it is written where :func:`few_calls` says so."""
        if Kernel.plain:
            before = [(arg, arg.copy()) for arg in args if getattr(arg, "ndim", 0)]
            try:
                return self.py_func(*args, **kws)
            except (ArithmeticError, ValueError):  # plain Python raises where a kernel has inf or nan
                for arg, value in before:
                    arg[...] = value
        return self._dispatcher()(*args, **kws)

    @property
    def stated(self) -> tuple[str, dict[str, Any]]:
        """Its one signature, and the types by the names that it gives them."""
        _, _, signatures, records = self._making
        (signature,) = signatures or ()
        return signature, records

    @property
    def _numba_type_(self) -> Any:
        """Type of this kernel in another one that calls it."""
        return self._dispatcher()._numba_type_

    def __getattr__(self, name: str) -> Any:
        if name.startswith("__"):  # what a library looks for in any object is no question to the compiler
            raise AttributeError(name)
        return getattr(self._dispatcher(), name)

    def __reduce__(self) -> str:
        """Pickle by name: the other process has the module."""
        return self.py_func.__qualname__


@contextlib.contextmanager
def few_calls(few: bool = True) -> Iterator[None]:
    """Run kernels as plain Python, where a question calls some ten of them: loading the compiler takes longer.

    Numbers differ from the compiled ones in their last bits: a compiled sum of products rounds once.

    Args:
        few: The question is such a one; else nothing changes.
    """
    import numpy as np

    before, Kernel.plain = Kernel.plain, few
    try:
        with np.errstate(all="ignore"):  # as compiled
            yield
    finally:
        Kernel.plain = before


_ENTRIES: Final[list[Kernel]] = []  # Entry points of the modules imported so far


def thread_count() -> int:
    """Return the number of threads that kernels may use."""
    import numba

    return int(numba.get_num_threads())


def entries(*rooms: str) -> list[Kernel]:
    """Return the entry points of the modules imported so far.

    Args:
        rooms: Modules, or packages with all below them, for example ``counterflex.runtime``.
    """
    return [
        function
        for function in _ENTRIES
        if any(f"{function.py_func.__module__}.".startswith(f"{room}.") for room in rooms)
    ]


def compile_stated(*rooms: str) -> None:
    """Compile all entry points, or read them from the cache: after this no call of them waits for it.

    Args:
        rooms: See :func:`entries`.
    """
    for function in entries(*rooms):
        function.compile_stated()


def kernel(
    signature: Any = None,
    *,
    parallel: bool = False,
    fast: bool = False,
    exact: bool = False,
    inline: bool = False,
    disjoint: bool = False,
    waits: bool = False,
    entry: bool = False,
    **records: Any,
) -> Callable[[F], F]:
    """Compile a pure array function with Numba when it is first needed, cached on disk.

    Args:
        signature: Numba signature string, list of them, or None to compile for whatever types it is called with.
            With signatures a wrong argument type is a TypeError and never a compilation. Kernels of the online loop
            must state them, and are compiled before it starts (:func:`compile_stated`).
        parallel: Allow ``prange``. Never for kernels called by the online process.
        fast: Allow re-association of sums (``fastmath={'reassoc','contract','nsz','arcp'}``), never NaN tricks.
        exact: Round every product and every sum, as Python does; else a product is added without being rounded.
        inline: Put the function into its callers: Numba does, or LLVM where it is ``disjoint``.
        disjoint: No two of its arrays share memory, and it makes none: its loops run in vectors without a look at
            addresses, and nothing is counted.
        waits: Called from Python it may wait long: other threads of the process run meanwhile.
        entry: Python calls it where no call may wait: :func:`compile_stated` is to make it ready. It states its
            signatures.
        records: Types (:func:`counterflex.core.records.record`, :func:`bundle`) by the name that the signature string
            gives them:
            ``kernel("void(Memory[::1], Row, float64)", Memory=MEMORY, Row=ROW)``, an array of them and an open one.

    Returns:
        A decorator that keeps the Python signature for the type checker.
    """
    options: dict[str, Any] = {
        "nopython": True,
        "boundscheck": None,
        "nogil": parallel or waits,
        "parallel": parallel,
        "error_model": "numpy",
        "fastmath": {"reassoc", "contract", "nsz", "arcp"} if fast else not exact and {"contract"},
    }
    if disjoint:
        options.update(forceinline=inline, noalias=True, _nrt=False)
    elif inline:
        options["inline"] = "always"

    def decorate(function: F) -> F:
        if not COMPILES:
            return function
        stated = None if signature is None else tuple(signature if isinstance(signature, list) else [signature])
        made = Kernel(function, options, stated, records)
        if entry and stated is not None:
            _ENTRIES.append(made)
        return cast(F, made)

    return decorate
