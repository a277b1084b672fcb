"""Processor and library versions of this machine, on which the exact bits of the forces depend."""

import platform
import zlib
from importlib.metadata import version
from pathlib import Path

from threadpoolctl import threadpool_info

#: Lines of /proc/cpuinfo that name a processor, on x86 and on ARM.
_PROCESSOR_KEYS = ("model name", "CPU implementer", "CPU part", "CPU variant", "CPU revision")

#: Lines that list its instruction sets: a virtual machine may hide some, and kernels are chosen by them.
_CPU_FLAG_KEYS = ("flags", "Features")


def platform_versions(cpuinfo: Path = Path("/proc/cpuinfo")) -> dict[str, str]:
    """Return the header entries `processor`, `libc`, `blas`, `python`, `numpy` and `onnxruntime` of this process.

    NumPy's BLAS chooses its routines by the processor, or by an environment variable: `blas` names which it took.
    """
    return {
        "processor": _processor_description(cpuinfo),
        "libc": " ".join(platform.libc_ver()),
        "blas": _blas_description(),
        "python": platform.python_version(),
        "numpy": version("numpy"),
        "onnxruntime": version("onnxruntime"),
    }


def _processor_description(cpuinfo: Path) -> str:
    lines = cpuinfo.read_text(errors="replace").splitlines() if cpuinfo.exists() else []
    first_values: dict[str, str] = {}
    for line in lines:
        key, _, value = line.partition(":")
        first_values.setdefault(key.strip(), value.strip())
    names = " ".join(first_values[key] for key in _PROCESSOR_KEYS if key in first_values)
    features = " ".join(sorted(" ".join(first_values.get(key, "") for key in _CPU_FLAG_KEYS).split()))
    return f"{platform.machine()} {names} [{zlib.crc32(features.encode()):08x}]"


def _blas_description() -> str:
    """Return name, version and routines of each BLAS of this process."""
    return ", ".join(
        " ".join(filter(None, (found["internal_api"], found["version"], found.get("architecture"))))
        for found in threadpool_info()
        if found["user_api"] == "blas"
    )
