"""Lower bound for the cycle time: the same cycle written in C (`c_program.c`), compiled and loaded by ctypes."""

import ctypes
import importlib.util
import math
import shutil
import subprocess
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from footsense.config import Config
from footsense.daemon.foot_types import released_path
from footsense.errors import FootsenseError
from footsense.estimation.elements import RESIDUAL_LIMIT, RESIDUAL_LIMIT_REL
from footsense.estimation.network import MAX_READING_INTERVAL_SCANS
from footsense.foot.capacitor import EPS0_PF_UM_PER_MM2
from footsense.foot.files.network_card import TrainedInputs
from footsense.frames import ELEMENTS, CapFrame, Stamps, Vector

_C_SOURCE_FILE = Path(__file__).with_name("c_program.c")
_LEGS = 6


def compiler() -> str | None:
    """Return the path of the first C compiler found; None without one."""
    return next((found for name in ("cc", "gcc", "clang") if (found := shutil.which(name))), None)


def has_c_program() -> bool:
    """Return whether a C compiler and the package `onnx` are installed, both needed for the C program."""
    return compiler() is not None and importlib.util.find_spec("onnx") is not None


def converter_codes(scan: CapFrame) -> NDArray[np.int32]:
    """Return the converter codes of a capacitance frame, shape (legs, 9)."""
    return np.ascontiguousarray(np.rint(scan.capacitance_pf * 2.0**19), np.int32)


def _layer_matrices(model: bytes) -> dict[str, NDArray[np.float32]]:
    """Return the network's layers by name as full weight matrices, inputs along rows, shared weights repeated."""
    import onnx

    graph = onnx.load_model_from_string(model).graph
    c = {tensor.name: onnx.numpy_helper.to_array(tensor) for tensor in graph.initializer}
    n_channels, n_turns = len(c["b1"]), len(c["turns"])
    w1 = c["w1"][:, c["seen_at"]].reshape(n_channels, n_turns, -1).transpose(2, 1, 0)
    w2 = c["w2"].reshape(n_channels, n_turns, n_channels)[:, c["relative_at"]]
    w2 = w2.reshape(n_channels, n_turns, n_turns, n_channels).transpose(2, 3, 1, 0)
    n_units = n_turns * n_channels
    return {
        "w1": w1.reshape(-1, n_units),
        "b1": np.tile(c["b1"], n_turns),
        "w2": w2.reshape(n_units, n_units),
        "b2": np.tile(c["b2"], n_turns),
        "out": (c["out"] @ c["turns"]).reshape(n_units, -1),
        "sigma": (c["sigma"] @ c["sizes"]).reshape(n_units, -1),
        "sigma_offset": c["sigma_offset"][c["sigma_axes"]],
        "level": (c["level_of"] @ c["linear"] @ c["linear_basis"]).reshape(ELEMENTS, 3),
        "slope": (c["slope_of"] @ c["linear"] @ c["linear_basis"]).reshape(ELEMENTS, 3),
        "soft": c["soft"],
        "period_s": 1.0 / c["per_period"],
        "largest": c["highest"],
        "least_s": -c["least_s"],
        "ln_low": c["ln_lowest"],
        "ln_high": c["ln_highest"],
    }


class CProgram:
    """The daemon's cycle as a C program, as a lower bound for the cycle time.

    Args:
        folder: Folder for the library.
        config: A robot of six legs without stray.
        calibration: Inputs that the network was trained for.

    Raises:
        FootsenseError: There is no compiler, or it fails.
    """

    def __init__(self, folder: Path, config: Config, calibration: TrainedInputs) -> None:
        weights = _layer_matrices(released_path("network.onnx").read_bytes())
        library = _compile_library(folder, len(weights["b1"]))
        design = calibration.design
        n = _LEGS * ELEMENTS
        precision = np.linalg.inv(calibration.moments)
        residual = precision / precision.diagonal()[:, None]
        foot = np.concatenate(
            [
                [EPS0_PF_UM_PER_MM2 * design.electrode_area_mm2, design.gap_um],
                np.zeros(n),
                np.full(n, design.unloaded_pf),
                calibration.closure_rel_min,
                calibration.closure_rel_max,
                [
                    config.effective_max_age_ms * 1e6,
                    MAX_READING_INTERVAL_SCANS * config.shortest_scan_ms * 1e6,
                ],
                *(residual.ravel(), [RESIDUAL_LIMIT, RESIDUAL_LIMIT_REL / math.sqrt(ELEMENTS)]),
            ]
        )
        flat = np.concatenate([part.ravel() for part in weights.values()]).astype(np.float32)
        library.floor_set(_data_pointer(foot), _data_pointer(flat))
        self._library = library
        self._force_n = np.zeros((_LEGS, 3))

    def tare(self, baseline_pf: Vector) -> None:
        """Set the baseline capacitances of all legs [pF], shape (legs, 9)."""
        baseline_pf = np.ascontiguousarray(baseline_pf, np.float64)
        self._library.floor_tare(_data_pointer(baseline_pf))

    def run(self, scan: CapFrame, codes: NDArray[np.int32], now_ns: int, socket: int, pipe: int) -> Vector:
        """Run one cycle of the C program; return its forces [N], shape (legs, 3).

        Args:
            scan: The scan.
            codes: Its converter codes, shape (legs, 9).
            now_ns: Time of the cycle [ns].
            socket: File descriptor for the frames.
            pipe: File descriptor for the record.

        Returns:
            Forces of healthy legs [N], shape (legs, 3), valid until the next call; of others without meaning.
        """
        self._library.floor_cycle(
            *(codes.ctypes.data, scan.t_ns.ctypes.data, now_ns, socket, pipe, self._force_n.ctypes.data)
        )
        return self._force_n

    def measure_wakeup_latencies_ns(
        self, period_ns: int, scan_sequence: list[tuple[CapFrame, int]], n: int, fds: tuple[int, ...]
    ) -> Stamps:
        """Run `n` cycles of the C program, one per period; return the wake-up latency of each [ns].

        Args:
            period_ns: Time from deadline to deadline [ns].
            scan_sequence: Scans, each with the time of its cycle [ns].
            n: Cycles.
            fds: File descriptors as of `Loopback.file_descriptors`.

        Returns:
            Wake-up latency of each cycle [ns], shape (n,).
        """
        scans, times = zip(*scan_sequence, strict=True)
        codes = np.stack([converter_codes(scan) for scan in scans])
        t_ns = np.stack([scan.t_ns for scan in scans])
        now_ns, late_ns = np.array(times, np.int64), np.zeros(n, np.int64)
        self._library.floor_pace(
            *(
                period_ns,
                n,
                _data_pointer(codes),
                _data_pointer(t_ns),
                _data_pointer(now_ns),
                len(scans),
                scan_sequence_duration_ns(scan_sequence),
            ),
            *(*fds, _data_pointer(late_ns)),
        )
        return late_ns


def scan_sequence_duration_ns(scan_sequence: list[tuple[CapFrame, int]]) -> int:
    """Return the duration of one pass through a sequence of frames [ns]."""
    return scan_sequence[-1][1] - scan_sequence[0][1] + (scan_sequence[1][1] - scan_sequence[0][1])


def _data_pointer(array: NDArray[Any]) -> ctypes.c_void_p:
    """Return the address of an array's data for C."""
    return ctypes.c_void_p(array.ctypes.data)


def _compile_library(folder: Path, n_units: int) -> ctypes.CDLL:
    """Compile the C program, and load it as a shared library.

    Raises:
        FootsenseError: There is no compiler, or it fails.
    """
    found = compiler()
    if found is None:
        raise FootsenseError("no C compiler (cc, gcc or clang) for the floor of the cycle")
    target = folder / "bench_floor.so"
    options = ("-std=gnu11", "-O2", "-march=native", f"-DUNITS={n_units}", "-fPIC", "-shared")
    done = subprocess.run(  # noqa: S603 - our own source
        [found, *options, "-o", str(target), str(_C_SOURCE_FILE), "-lm"],
        check=False,
        capture_output=True,
        text=True,
    )
    if done.returncode:
        raise FootsenseError(
            f"{found} does not compile {_C_SOURCE_FILE.name}: {done.stderr.strip().splitlines()[0]}"
        )
    library = ctypes.CDLL(str(target))
    i32, i64, address = ctypes.c_int, ctypes.c_int64, ctypes.c_void_p
    library.floor_cycle.argtypes = [address, address, i64, i32, i32, address]
    library.floor_pace.argtypes = [i64, i32, address, address, address, i32, i64, i32, i32, i32, i32, address]
    library.floor_pace.restype = None
    library.floor_set.restype = library.floor_tare.restype = None
    return library
