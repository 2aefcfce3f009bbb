"""``njit`` of Numba, whose kernels are loaded in a tenth of the time.

Where Numba loads a kernel that it has kept, it first imports all that it compiles with, and reads the kernel's
intermediate code, from which those that call it would be compiled. No kernel needs either to run. Here both wait until
something is compiled. What is kept is what Numba keeps, file for file.

A kernel has in it what it calls and the constants that it reads of other files. Numba asks only whether its own file is
another one, and after an update would run the new kernels with the old ones in them. Here every file counts on which
the one of a kernel rests.

This rests on the inside of Numba, which has been the same in the versions of ``KNOWN``: with any other, ``njit`` is
Numba's own.
"""
# mypy: allow-untyped-calls

from __future__ import annotations

import re
from functools import cache
from hashlib import sha256
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numba
from llvmlite import binding  # type: ignore[import-untyped]
from numba.core.caching import CompileResultCacheImpl, FunctionCache
from numba.core.codegen import JITCodeLibrary
from numba.core.dispatcher import Dispatcher
from numba.core.runtime.nrt import rtsys

__all__ = ["njit", "stamp_of"]

_ROOT = Path(__file__).resolve().parent
#: Where from, as ``.a.b``, and what: names of one file, or files of one folder.
_IMPORTED = re.compile(rf"^\s*from {_ROOT.name}((?:\.\w+)*) import (\([^)]*\)|.*)", re.MULTILINE)

#: Versions (minor numbers of 0.x) whose inside was compared.
KNOWN = range(60, 69)
_IS_KNOWN = numba.version_info.major == 0 and numba.version_info.minor in KNOWN
#: In the names of what Numba's hashes use, which it makes known when it imports what it compiles with.
_HASHES = b"_numba_hashsecret"


if TYPE_CHECKING:
    from numba import njit
else:

    def njit(*, cache=False, **options):
        """As Numba's; what is divided by zero is no number, and does not end who flies."""
        options = {"error_model": "numpy", **options}
        if not (cache and _IS_KNOWN):
            return numba.njit(cache=cache, **options)

        def compiled_when_called(function):
            kernel = numba.njit(no_cfunc_wrapper=True, **options)(function)
            if isinstance(kernel, Dispatcher):  # it is the function itself where Numba is turned off
                kernel._cache = _Cache(function)
            return kernel

        return compiled_when_called


@cache
def _read(path: Path) -> tuple[bytes, tuple[Path, ...]]:
    """The hash of a file of source; where it has kernels, the files of the package that it imports, too."""
    content = path.read_text(encoding="utf8")
    files: list[Path] = []
    for where, names in _IMPORTED.findall(content) if "njit" in content else ():
        folder = _ROOT.joinpath(*where.split("."))
        files += [folder.with_suffix(".py"), *(folder / f"{name}.py" for name in re.findall(r"\w+", names))]
    return sha256(content.encode()).digest(), tuple(file for file in files if file.is_file())


@cache
def stamp_of(path: Path) -> str:
    """One hash over a file of source and all that its kernels rest on: those that it imports, and so on."""
    known: dict[Path, bytes] = {}
    waiting = [path]
    while waiting:
        file = waiting.pop()
        if file not in known:
            known[file], imported = _read(file)
            waiting += imported
    return sha256(b"".join(known[file] for file in sorted(known))).hexdigest()


class _Library(JITCodeLibrary):
    """A compiled kernel from the cache; its intermediate code is read when a kernel that calls it is compiled."""

    _unread: bytes | None = None
    _read: Any = None

    @classmethod
    def _unserialize(cls, codegen: Any, state: Any) -> Any:
        name, kind, data = state
        if kind != "object":
            return super()._unserialize(codegen, state)
        library = codegen.create_library(name)
        library.enable_object_caching()
        compiled, library._unread = data
        library._set_compiled_object(compiled)
        library._finalize_final_module()
        return library

    @property
    def _shared_module(self) -> Any:
        if self._unread is not None:
            self._read, self._unread = binding.parse_bitcode(self._unread), None
            self._codegen._engine._load_defined_symbols(self._read)
        return self._read

    @_shared_module.setter
    def _shared_module(self, module: Any) -> None:
        self._read = module

    def get_pointer_to_function(self, name: str) -> Any:
        if not self._codegen._engine.is_symbol_defined(name):
            _ = self._shared_module  # whose names are then known
        return super().get_pointer_to_function(name)


class _Rebuilding(CompileResultCacheImpl):
    def rebuild(self, target_context: Any, payload: Any) -> Any:
        (_, kind, data), description, *_ = payload
        if kind == "object" and _HASHES in data[0]:
            target_context.refresh()
        codegen = target_context.codegen()
        codegen._engine._defined_symbols.add(description.llvm_cpython_wrapper_name)  # which is what Python calls
        codegen._library_class = _Library
        try:
            return super().rebuild(target_context, payload)
        finally:
            del codegen._library_class  # that of its class is the usual one


class _Cache(FunctionCache):
    _impl_class = _Rebuilding

    def __init__(self, py_func: Any) -> None:
        super().__init__(py_func)
        own = self._cache_file._source_stamp
        self._cache_file._source_stamp = (own, stamp_of(Path(py_func.__code__.co_filename)))

    def load_overload(self, sig: Any, target_context: Any) -> Any:
        rtsys.initialize(target_context)  # memory of arrays; `refresh` does this and imports the rest
        with self._guard_against_spurious_io_errors():
            return self._load_overload(sig, target_context)
