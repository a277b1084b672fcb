"""The decoder of `firmware_interface/c`, built with whatever compiles C here, and called from Python."""

import ctypes
import os
import shlex
import shutil
import subprocess
import sys
from functools import cache
from pathlib import Path
from tempfile import mkdtemp

from footsense.client import LegForce, LinkLimits, LinkStatus

__all__ = ["SOURCES", "WARNINGS", "CLink", "build_library", "compile_c", "library"]

SOURCES = Path(__file__).parents[2] / "firmware_interface/c"

WARNINGS = ["-std=c99", "-O2", "-Wall", "-Wextra", "-Wpedantic", "-Wconversion", "-Wshadow", "-Werror"]


def _compiler() -> list[str]:
    """Return the first C compiler that is there; the last is a Python package, so that one always is."""
    if os.environ.get("CC"):
        return shlex.split(os.environ["CC"])
    for name in ("cc", "gcc", "clang"):
        if shutil.which(name):
            return [name]
    return [sys.executable, "-m", "ziglang", "cc"]


def compile_c(folder: Path, *arguments: str | Path) -> None:
    """Compile without a single warning; the compiler's own caches stay in `folder`."""
    environment = os.environ | {"ZIG_GLOBAL_CACHE_DIR": str(folder), "ZIG_LOCAL_CACHE_DIR": str(folder)}
    command = [*_compiler(), *WARNINGS, *map(str, arguments)]
    done = subprocess.run(command, cwd=folder, env=environment, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr


class _Limits(ctypes.Structure):
    _fields_ = (
        ("max_age_us", ctypes.c_uint32),
        ("timeout_us", ctypes.c_uint32),
        ("max_delta", ctypes.c_uint8),
        ("min_good", ctypes.c_uint8),
        ("accept_degraded", ctypes.c_bool),
    )


class _View(ctypes.Structure):
    _fields_ = (
        ("status", ctypes.c_int),
        ("usable", ctypes.c_bool),
        ("state", ctypes.c_uint8),
        ("flags", ctypes.c_uint8),
        ("fault_mask", ctypes.c_uint16),
        ("force_mn", ctypes.c_int32 * 3),
        ("sigma_un", ctypes.c_uint32 * 3),
        ("contact_permille", ctypes.c_uint16),
        ("holds_permille", ctypes.c_uint16),
        ("age_us", ctypes.c_uint32),
    )


#: More room than a footsense_link takes; the test never looks into it.
_LINK_BYTES = 4096


def build_library(folder: Path) -> Path:
    """Return the decoder as a shared library."""
    files = [SOURCES / f"footsense_{name}.c" for name in ("can", "link", "gait", "serial")]
    compile_c(folder, "-shared", "-fPIC", *files, "-o", folder / "footsense.so")
    return folder / "footsense.so"


@cache
def library() -> ctypes.CDLL:
    """Return the decoder, built once in a process; or the one that was built before for a computer without compiler."""
    folder = Path(mkdtemp(prefix="footsense-c-"))
    try:
        built = ctypes.CDLL(os.environ.get("FOOTSENSE_C_LIBRARY") or str(build_library(folder)))
    finally:
        shutil.rmtree(folder)
    built.footsense_get_leg_force.restype = _View
    built.footsense_get_leg_force.argtypes = [ctypes.c_char_p, ctypes.c_uint8, ctypes.c_uint64]
    built.footsense_encode_record.restype = ctypes.c_uint8
    built.footsense_encode_sending.restype = ctypes.c_uint8
    built.footsense_crc16.restype = ctypes.c_uint16
    built.footsense_feed.restype = ctypes.c_bool
    built.footsense_feed.argtypes = [
        ctypes.c_char_p,
        ctypes.c_uint32,
        ctypes.c_char_p,
        ctypes.c_uint8,
        ctypes.c_uint64,
    ]
    return built


class CLink:
    """`footsense.client.Link`, in C."""

    def __init__(self, limits: LinkLimits) -> None:
        self._library = library()
        self._link = ctypes.create_string_buffer(_LINK_BYTES)
        given = _Limits(
            limits.max_age_ns // 1000,
            limits.timeout_ns // 1000,
            limits.max_delta,
            limits.min_good,
            limits.accept_degraded,
        )
        self._library.footsense_link_init(self._link, ctypes.byref(given))

    def feed(self, can_id: int, data: bytes, t_us: int) -> bool:
        """Take a frame."""
        fed: bool = self._library.footsense_feed(self._link, can_id, data, len(data), t_us)
        return fed

    def look(self, node: int, t_us: int) -> tuple[object, ...]:
        """Return what is known of a leg, in the units of C: mN, uN, us and permille."""
        view = self._library.footsense_get_leg_force(self._link, node, t_us)
        return (
            LinkStatus(view.status),
            view.usable,
            view.state,
            view.flags,
            view.fault_mask,
            tuple(view.force_mn),
            tuple(view.sigma_un),
            view.age_us,
            view.contact_permille,
            view.holds_permille,
        )


def in_c_units(view: LegForce) -> tuple[object, ...]:
    """Return a view of Python as C says it."""
    forces = tuple(-(2**31) if force_n != force_n else round(force_n * 1000) for force_n in view.force_n)  # noqa: PLR0124
    sigmas = tuple(0xFFFFFFFF if sigma_n != sigma_n else round(sigma_n * 1e6) for sigma_n in view.sigma_n)  # noqa: PLR0124
    age_us = 0xFFFFFFFF if view.age_ns is None else view.age_ns // 1000
    mask = 0xFFFF if view.fault_mask is None else view.fault_mask
    contact = (0xFFFF if p != p else round(p * 1000) for p in (view.contact_probability, view.holds))  # noqa: PLR0124
    return (*view[:4], mask, forces, sigmas, age_us, *contact)
