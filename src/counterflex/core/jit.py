"""Compiled kernels: one decorator that keeps types for the checker and a cache that cannot go stale.

Numba's on-disk cache does not see changes in other source files, and it needs a writable place. Each kernel is
therefore cached in a folder named after a hash of its module and of every kernel module that this one imports, in the
user's own folder (:mod:`counterflex.core.user_folder`): compiled code is executed when it is read. Where that folder
cannot be written, code is kept as long as the process. Processes that need the same kernel at the same
time compile it once: one compiles, the others wait and read it.

Nothing is compiled or read when a module is imported. A kernel that states its signatures is compiled for them, and
for nothing else, when it is first called or called by a kernel that is being compiled; :func:`compile_stated` does it
before, where a first call must not wait: the online loop. It does so for entry points only, the kernels that Python
calls: the code of what these call is part of theirs.
Set ``NUMBA_DISABLE_JIT=1`` to step through kernels in plain Python.
"""

from __future__ import annotations

import atexit
import contextlib
import functools
import hashlib
import re
import shutil
import sys
import tempfile
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any, Final, TypeVar, cast

import numba
import numpy as np
from numba.core.caching import CompileResultCacheImpl, FunctionCache, NullCache, UserProvidedCacheLocator
from numba.core.compiler_lock import global_compiler_lock
from numba.core.registry import CPUDispatcher

if sys.platform != "win32":
    import fcntl

F = TypeVar("F", bound=Callable[..., Any])

prange = numba.prange

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
def cache_folder(module: str) -> Path:
    """Folder for the compiled kernels of a module, named after all sources they depend on.

    Args:
        module: Full dotted name, for example ``counterflex.plan.cut_kernel``.
    """
    name = module.removeprefix("counterflex.")
    digest = hashlib.sha256(f"{numba.__version__} {sys.version_info[:2]}".encode())
    for dependency in sorted(_closure(name)):
        digest.update(dependency.encode())
        digest.update(_source(dependency) or b"")
    return _cache_root() / f"{name}-{digest.hexdigest()[:16]}"


def bundle(kind: type, /, **fields: Any) -> Any:
    """Type of a NamedTuple of arrays and numbers, for a kernel that takes one.

    Args:
        kind: The NamedTuple.
        fields: Type of each of its fields as a signature writes it (``"float64[:, ::1]"``), or another bundle.

    Raises:
        KeyError: A field without a type.
    """
    known = vars(numba.types)
    types = (fields[name] for name in kind._fields)  # type: ignore[attr-defined]
    return numba.types.NamedTuple([eval(one, known) if isinstance(one, str) else one for one in types], kind)


_record_type = functools.cache(numba.from_dtype)


def _with_records(signature: str, records: dict[str, Any]) -> Any:
    """A signature in which the names of records and bundles stand for their types."""
    named = {name: _record_type(kind) if isinstance(kind, np.dtype) else kind for name, kind in records.items()}
    return eval(signature, vars(numba.types) | named)


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


class _Code(CompileResultCacheImpl):  # type: ignore[misc]
    """How compiled code is written and read: Numba's way, in that place."""

    _locator_classes: Final = (_BySources,)  # Numba's other places are not proven to be this user's alone


class _SharedCache(FunctionCache):  # type: ignore[misc]
    """Numba's cache of one function, asked again when no other process is compiling that function any more."""

    _impl_class = _Code

    def __init__(self, function: Callable[..., Any]) -> None:
        super().__init__(function)
        self._name_of_lock = f"{function.__qualname__}-{function.__code__.co_firstlineno}.lock"
        self.locks: contextlib.ExitStack | None = None

    def load_overload(self, sig: Any, target_context: Any) -> Any:
        result = self._loaded(sig, target_context)
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


class _Kernel(CPUDispatcher):  # type: ignore[misc]
    """A compiled function that is compiled for the stated signatures when it is first needed, and for no other type."""

    _only_stated = False
    _stated: tuple[Any, ...] = ()
    _records: dict[str, Any]

    def state(self, signatures: tuple[Any, ...], records: dict[str, Any]) -> None:
        """State the only signatures that it will ever have; their names are looked up when they are needed."""
        self._only_stated, self._stated, self._records = True, signatures, records

    def enable_caching(self) -> None:
        try:
            self._cache = _SharedCache(self.py_func)
        except RuntimeError:  # Numba found no place
            self._cache = _NoCache()

    def compile(self, sig: Any) -> Any:
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
                    self.compile(_with_records(signature, self._records) if self._records else signature)
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
        self.compile_stated()
        return super().get_call_template(args, kws)

    def _reduce_states(self) -> Any:
        self.compile_stated()
        return super()._reduce_states()


_ENTRIES: Final[list[_Kernel]] = []
"""Entry points of the modules imported so far."""


def compile_stated(*rooms: str) -> None:
    """Compile all entry points, or read them from the cache: after this no call of them waits for it.

    Args:
        rooms: Modules, or packages with all below them, for example ``counterflex.runtime``; those imported so far.
    """
    for function in _ENTRIES:
        module = function.py_func.__module__
        if any(module == room or module.startswith(room + ".") for room in rooms):
            function.compile_stated()


def kernel(
    signature: Any = None,
    *,
    parallel: bool = False,
    fast: bool = False,
    inline: bool = False,
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
        inline: Let Numba inline the function into its callers.
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
        "fastmath": {"reassoc", "contract", "nsz", "arcp"} if fast else {"contract"},
    }
    if inline:
        options["inline"] = "always"

    def decorate(function: F) -> F:
        if numba.config.DISABLE_JIT:
            return function
        numba.config.CACHE_DIR = str(cache_folder(function.__module__))
        compiled = _Kernel(function, targetoptions=options)
        compiled.enable_caching()
        if signature is not None:
            stated = signature if isinstance(signature, list) else [signature]
            compiled.state(tuple(stated), records)
            if entry:
                _ENTRIES.append(compiled)
        return cast(F, compiled)

    return decorate
