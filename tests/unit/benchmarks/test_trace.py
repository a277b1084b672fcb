"""How much of our code one conversion of six legs runs through."""

from footsense.benchmarks.trace import calls_per_conversion, functions_called_steadily


def test_a_conversion_of_six_legs_stays_within_its_modules_and_calls() -> None:
    """Registers, recorder and run statistics included; the simulator is left out."""
    calls, _ = calls_per_conversion(n=1000)
    modules = {module for module, _ in functions_called_steadily(calls)}
    for part in (
        "acquisition/boards/fdc1004.py",
        "estimation/network.py",
        "can/sink.py",
        "ring/cycle_ring.py",
    ):
        assert f"footsense/{part}" in modules
    assert not any(module.startswith("footsense/sim/") for module in modules)
    assert len(modules) <= 24, sorted(modules)
    assert sum(calls.values()) <= 91
