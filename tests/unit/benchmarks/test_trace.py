"""How much of our code one scan of six legs runs through."""

from footsense.benchmarks.trace import calls_per_scan, steady_functions


def test_a_scan_of_six_legs_stays_within_its_modules_and_calls() -> None:
    """Registers, frames on CAN, recorder and run statistics included; the simulator is left out."""
    calls, _ = calls_per_scan(n_scans=60)
    modules = {module for module, _ in steady_functions(calls)}
    for part in (
        "acquisition/boards/fdc1004.py",
        "estimation/network.py",
        "can/sink.py",
        "recording/cycle_pipe.py",
    ):
        assert f"footsense/{part}" in modules
    assert not any(module.startswith(("footsense/sim/", "footsense/foot/")) for module in modules)
    assert len(modules) <= 24, sorted(modules)
    assert sum(calls.values()) <= 900
