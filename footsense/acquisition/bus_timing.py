"""The limits of the scan of a bus, which follow from the cost of its transactions."""

from typing import NamedTuple

from firmware_interface.schedule import ScanLimits, scan_limits
from footsense.acquisition.bus_costs import BusCosts
from footsense.acquisition.scan_plan import ScanPlan
from footsense.frames import ELEMENTS


class Timing(NamedTuple):
    """Cost and limits of a bus.

    Attributes:
        costs: Cost of its transactions.
        limits: The shortest scans that they allow.
        conversions_ns: Time of nine conversions without any transaction [ns].
    """

    costs: BusCosts
    limits: ScanLimits
    conversions_ns: int

    @property
    def late_ns(self) -> int:
        """Age of a conversion from which the loop must have been delayed [ns]: two steps."""
        return 2 * self.limits.scan_ns // ELEMENTS

    def __str__(self) -> str:
        """Return one line for the journal."""
        rate_hz, host_cost_ns = self.costs
        return (
            f"{rate_hz * 1e-3:.0f} kHz and {host_cost_ns * 1e-3:.0f} us of host per transaction; the best scan takes "
            f"{self.limits.scan_ns * 1e-6:.1f} ms, {self.limits.scan_ns / self.conversions_ns:.2f} x its conversions; "
            f"the limit is the {self.limits.limiting_factor}"
        )


def timing(costs: BusCosts, plan: ScanPlan, n_legs: int, *, kernel_mux: bool) -> Timing:
    """Return the transaction costs, the scan limits and the conversion time of a bus.

    Args:
        costs: Cost of its transactions.
        plan: The conversions of one scan.
        n_legs: Legs on it.
        kernel_mux: Whether the kernel drives its mux.
    """
    limits = scan_limits(
        n_legs=n_legs,
        conversion_ns=plan.conversion_ns,
        rate_hz=costs.rate_hz,
        host_cost_ns=costs.host_cost_ns,
        n_result_reads=len(plan.steps[0].read),
        kernel_mux=kernel_mux,
        traffic=plan.board.traffic,
    )
    return Timing(costs, limits, len(plan.steps) * plan.conversion_ns)


def time_for_checks(costs: BusCosts, plan: ScanPlan, n_legs: int) -> tuple[bool, bool]:
    """Return which checks fit into a conversion after the read-out of all legs.

    Returns:
        Whether there is time to ask for lines and settings, and then to read the mux back after every leg.
    """
    step, select_ns = plan.steps[0], costs.transaction_ns(1)
    checks = (*step.select_checks, plan.board.setting_check)
    ask_ns = costs.total_ns([step.done.read] if step.done else [])
    spare_ns = plan.wait_ns - ask_ns - select_ns - n_legs * (select_ns + costs.total_ns(step.read))
    spare_ns -= costs.total_ns(check.read for check in checks)
    return spare_ns >= 0, spare_ns >= (1 + n_legs) * costs.transaction_ns(0, 1)
