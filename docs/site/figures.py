"""Figures of the report in the documents: the text between `<!--figure NAME-->` and `<!--end-->` is that of a name here.

`TABLES` are whole parts of pages, between the lines that `reference.py` looks for. Each figure is computed from the JSON
of a page of the report, so that none is typed.
"""

import json
import re
from collections.abc import Callable, Mapping, Sequence
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np

from firmware_interface.chips import ad7147
from footsense.sim.chips.beside import unloaded_stray_pf
from footsense.sim.couplings import COUPLINGS_FILE, Couplings, load_couplings

ROOT = Path(__file__).parents[2]
REPORT = ROOT / "docs" / "report"
MARK = re.compile(r"<!--figure (?P<name>[\w.-]+)-->(?P<text>.*?)<!--end-->", re.DOTALL)

_MN_PER_GF = 9.80665
#: Capacitance of an unloaded element of the smallest foot [pF].
_UNLOADED_PF = 5.387
_PAPER_FOOT, _HEXAPOD_FOOT, _QUADRUPED_FOOT = "aoyagi-3x3", "hexapod-2kg", "quadruped-12kg"
_FEET = (_PAPER_FOOT, _HEXAPOD_FOOT, _QUADRUPED_FOOT)
#: Boards of the front page: the default, and that with one converter in a foot.
_DEFAULT, _SMALL = "ad7147", "fdc1004"
#: Weight over the legs that carry a walking robot: three of six, two of four [N].
_SHARE_N = {_HEXAPOD_FOOT: 2.0 * 9.80665 / 3, _QUADRUPED_FOOT: 12.0 * 9.80665 / 2}


@cache
def _page(name: str) -> Any:  # noqa: ANN401 - JSON
    return json.loads((REPORT / f"{name}.json").read_text("utf-8"))


def _board(board: str) -> Any:  # noqa: ANN401
    return _page("motion")["boards"][board]


def _robots(board: str, foot: str = _PAPER_FOOT) -> Any:  # noqa: ANN401
    return _board(board)["pooled"][foot]


def _own_robot(board: str, place: int) -> Any:  # noqa: ANN401
    return list(_board(board)["own_robots"].values())[place]


def _run(foot: str, gait: str) -> Any:  # noqa: ANN401
    return next(row for row in _board(_DEFAULT)["runs"][foot] if row["run"] == f"{foot} {gait}")


def _range_n(foot: str, lean: int) -> float:
    """Return the range under a force that leans by 0, 14 or 30 deg, the entries 0 to 2 [N]."""
    return float(_page("design")["feet"][foot]["built"]["upright_range_n"][lean])


def _made(calibration: str, test: str = "centred", kind: str = "supposed") -> dict[str, Any]:
    """Return the errors of made feet as arrays [deg], [mN], and shares."""
    found = _page("experiment")["kinds"][kind][calibration][test]
    known = {key: np.array([one for one in values if one is not None]) for key, values in found.items()}
    return known | {"deg": known["true_deg"], "mn": _MN_PER_GF * known["true_gf"]}


def _published(rate_sps: int, publish_every: int) -> Any:  # noqa: ANN401
    return next(
        point
        for point in _page("speed-error")["published"]["points"]
        if (point["rate_sps"], point["publish_every"]) == (rate_sps, publish_every)
    )


def _others(key: str) -> list[Any]:
    return [_robots(_DEFAULT, foot)[key] for foot in (_HEXAPOD_FOOT, _QUADRUPED_FOOT)]


def _leaning(lean: int) -> str:
    small, middle, large = (_range_n(foot, lean) for foot in _FEET)
    return f"{small:.2f} N, {middle:.1f} N, {large:.0f} N"


#: What a robot knows of contact, in words, and as the page *odometry* calls it.
_ODOMETRY = {
    "footsense's force vector ([example](examples/odometry.py))": "`ad7147`, force vector",
    "a good one-axis force sensor in each foot": "good one-axis sensor, threshold",
}


def _drift(source: str, how: Callable[[Any], float], gate: str = "no gate") -> float:
    """Return the drift of the odometry [%]."""
    return 100.0 * how(_page("odometry")["drift"][source][gate])


def _front() -> str:
    own, small = _robots(_DEFAULT), _robots(_SMALL)
    walk = _board(_DEFAULT)["couplings"]["measured walk, strays known, 100 us"]
    touches, missed, twice, in_air = (
        sum(_others(key)) for key in ("n_touches", "n_missed", "n_twice", "n_in_air")
    )
    pressed, standing, worn = _made("all"), _made("standing"), _made("all", kind="gains_wander")
    hexapod_ms, quadruped_ms = (f"{one:.0f} ms" for one in _others("delay_p50_ms"))
    n_walks = len(_page("odometry")["way_m"])
    rows = [
        *(
            (
                f"**Odometry**: error after a metre, from joint angles, IMU and {words}",
                f"{_drift(source, np.mean):.1f} %, or {_drift(source, np.mean, 'gate'):.1f} % if the filter rejects outliers",
                f"{_drift(source, np.max):.1f} % in the worst of {n_walks} walks, outliers kept",
            )
            for words, source in _ODOMETRY.items()
        ),
        (
            "**Contact** of robots that walk in a physics engine",
            f"{1 - missed / touches:.0%} of {touches} touchdowns found, {hexapod_ms} (hexapod) and {quadruped_ms} (quadruped) after the first load",
            f"1 in 100 found later than {max(_others('delay_p99_ms')):.0f} ms; {twice} reported twice; {in_air} reported in the air",
        ),
        (
            "**Direction error** of the forces of walking robots, smallest foot",
            f"{own['direction_deg']:.1f} deg; in a smooth walk {walk['direction_deg']:.1f}",
            f"worst gait {own['worst_direction_deg']:.1f} deg; hard landings alone {own['landings_direction_deg']:.1f} deg",
        ),
        (
            "The same with an FDC1004 in place of the AD7147",
            f"{small['direction_deg']:.1f} deg",
            f"worst gait {small['worst_direction_deg']:.1f} deg",
        ),
        (
            f"**Direction error of {len(pressed['deg'])} smallest feet with manufacturing tolerances**, loads of 1 N through the centre, calibrated beside a force sensor",
            f"{pressed['deg'].mean():.1f} deg; size of the force {pressed['true_gf'].mean():.1f} % off; days later "
            f"{worn['deg'].mean():.1f} deg, if elements change as [an insole's](docs/report/real-sensors.md) did at most",
            f"{pressed['deg'].max():.1f} deg; {worn['deg'].max():.1f}",
        ),
        (
            "These feet, [calibrated only by standing](docs/calibrate-a-foot.md#without-a-force-sensor-by-standing)",
            f"{standing['deg'].mean():.1f} deg; size of the force 20 % off, 6 % if the robot's mass is given",
            f"{standing['deg'].max():.1f} deg",
        ),
        (
            "19 feet of the hexapod with such tolerances, [corrected only by a minute of walking](docs/adr/0038-electrodes-by-walking.md)",
            "0.8 deg (11 before); if capacitances are 3 % off the model 4.8 deg, which is not in sigma",
            "1.5 deg",
        ),
        (
            "**Range** of the three designs: largest normal force where the force is tilted by 30 deg",
            _leaning(2),
            f"weakest of {_page('design')['n_feet']} with tolerances: "
            + ", ".join(f"{min(_page('design')['feet'][foot]['made_range_n']):.2g} N" for foot in _FEET),
        ),
    ]
    return "\n".join(
        [
            "| simulated | on average | worst |",
            "|---|---|---|",
            *(f"| {' | '.join(row)} |" for row in rows),
        ]
    )


def _rates() -> str:
    uses = {
        "weighing, calibrating": (100, 4),
        "walking, the default": (400, 4),
        "control of a walk": (400, 1),
    }
    lines = [
        "| for | `scan.rate_sps`, `publish_every` | age of the force in use | its error on a walk of 1 N, rms"
        " | noise, standing | CAN, six legs |",
        "|---|---|---:|---:|---:|---:|",
    ]
    for use, setting in uses.items():
        point = _published(*setting)
        walk = point["walk"]
        lines.append(
            f"| {use} | {setting[0]}, {setting[1]} | {walk['held_age_p50_p99_ms'][0]:.2g} ms | "
            f"{walk['held_error_norm_rms_mn']:.0f} mN | {point['standing_noise_norm_rms_mn']:.2f} mN | "
            f"{point['can_kbit_s']:.0f} kbit/s |"
        )
    return "\n".join(lines)


def _peaks() -> str:
    """Return the peaks of walking robots over the share of the weight that a foot carries."""

    def peak(foot: str, gait: str) -> str:
        return f"{_run(foot, gait)['peak_n'] / _SHARE_N[foot]:.1f}"

    rows = {
        "tripod of a hexapod, slow / fast": [
            (_HEXAPOD_FOOT, "tripod flat"),
            (_HEXAPOD_FOOT, "tripod-fast flat"),
        ],
        "trot of a quadruped, slow / fast": [
            (_QUADRUPED_FOOT, "trot-slow flat"),
            (_QUADRUPED_FOOT, "trot-fast flat"),
        ],
        "walk, one leg after another, hexapod / quadruped": [
            (_HEXAPOD_FOOT, "walk flat"),
            (_QUADRUPED_FOOT, "walk flat"),
        ],
        "hops, hexapod / quadruped": [(_HEXAPOD_FOOT, "hop flat"), (_QUADRUPED_FOOT, "hop flat")],
        "landings, hexapod / quadruped": [(_HEXAPOD_FOOT, "landing flat"), (_QUADRUPED_FOOT, "landing flat")],
    }
    lines = [f"| {gait} | {' / '.join(peak(*run) for run in runs)} |" for gait, runs in rows.items()]
    return "\n".join(["| gait | peak over the foot's share of the weight |", "|---|---:|", *lines])


def _ranges(foot: str) -> str:
    """Return the ranges of a foot by force, as on its card."""
    built = _page("design")["feet"][foot]["built"]
    rows = {
        "along the normal": built["upright_range_n"][0],
        "leaning 14 deg from the normal, to the worst side": built["upright_range_n"][1],
        "leaning 30 deg from the normal, to the worst side": built["upright_range_n"][2],
        "centred, 30 deg off the foot's axis": built["centred_range_n"],
    }
    lines = [f"| {force} | {range_n:.3g} |" for force, range_n in rows.items()]
    return "\n".join(["| force | range [N] |", "|---|---:|", *lines])


TABLES: Mapping[str, Callable[..., str]] = {
    "how-good": _front,
    "rates": _rates,
    "peaks": _peaks,
    "range-table": _ranges,
    "error-table": lambda foot: _page("rest")["error_tables"][foot].strip(),
}


def _made_as_read() -> dict[str, str]:
    """Return how far made feet err against their reference [deg]: uncalibrated, the worst of them, and pressed."""
    found = _page("experiment")["kinds"]["supposed"]
    design, few = (np.array(found[name]["centred"]["deg"]) for name in ("design", "few"))
    return {
        "deg": f"{design.mean():.1f}",
        "worst-deg": f"{design.max():.0f}",
        "pressed-deg": f"{few.mean():.1f}",
    }


def figures() -> dict[str, str]:
    """Return the text of each figure by its name."""
    own, small = _robots(_DEFAULT), _robots(_SMALL)
    found = {
        "robots.deg": f"{own['direction_deg']:.1f}",
        **{f"made.{name}": text for name, text in _made_as_read().items()},
        "fdc1004.robots.deg": f"{small['direction_deg']:.1f}",
        "robots.least-within-2-sigma": f"{own['least_within_2_sigma']:.0%}",
        "rest.leaning.deg": f"{_page('rest')['refined']['leaning, held out']['refined']['direction_deg']:.2f}",
        "rest.leaning.network.deg": f"{_page('rest')['refined']['leaning, held out']['network']['direction_deg']:.2f}",
        "hexapod.force-share": f"{1 - _robots(_DEFAULT, _HEXAPOD_FOOT)['no_force_share']:.1%}",
        "hexapod.hop.peak-n": f"{_run(_HEXAPOD_FOOT, 'hop flat')['peak_n']:.0f}",
        "hexapod.worst-force-share": f"{1 - _robots(_DEFAULT, _HEXAPOD_FOOT)['worst_no_force_share']:.1%}",
    }
    found["scans-hz"] = f"{1e9 / (9 * ad7147.DECIMATIONS[64].stage_ns):.0f}"
    for name, board in (("", _DEFAULT), ("fdc1004.", _SMALL)):
        for place, robot in enumerate(("hexapod", "quadruped")):
            walked = _own_robot(board, place)
            found[f"{name}{robot}.walk.deg"] = f"{walked['direction_deg']:.2f}"
            found[f"{name}{robot}.walk.size"] = f"{walked['magnitude_rel']:.1%}"
    for foot, short in zip(_FEET, ("small", "hexapod", "quadruped"), strict=True):
        for lean, degrees in enumerate((0, 14, 30)):
            range_n = _range_n(foot, lean)
            found[f"{short}.range-{degrees}-n"] = f"{range_n:.2f}" if range_n < 10 else f"{range_n:.3g}"
    found |= _couplings()
    found["small.centred-range-n"] = f"{_page('design')['feet'][_PAPER_FOOT]['built']['centred_range_n']:.2f}"
    return found


def _couplings() -> dict[str, str]:
    """Return ranges over the lines of the smallest foot, from its table [fF]."""
    boards = load_couplings(ROOT / "models" / _PAPER_FOOT / COUPLINGS_FILE).boards

    def spread(values: Sequence[float]) -> str:
        return f"{min(values):.0f} to {max(values):.0f}"

    found = {
        f"couplings.{board}.metal-ff": spread(of_board.element_metal_ff) for board, of_board in boards.items()
    }
    stray_pf = unloaded_stray_pf("fdc1004", boards["fdc1004"], Couplings(), _UNLOADED_PF)
    return found | {
        "couplings.stray-pf": f"{min(stray_pf):.1f} to {max(stray_pf):.1f}",
    }


def filled(text: str, where: str) -> str:
    """Return a document's text with each marked figure as the report has it.

    Raises:
        ValueError: There is no figure of some name.
    """
    known = figures()

    def figure(mark: re.Match[str]) -> str:
        if mark["name"] not in known:
            raise ValueError(f"{where}: no figure {mark['name']!r}; docs/site/figures.py has them")
        return f"<!--figure {mark['name']}-->{known[mark['name']]}<!--end-->"

    return MARK.sub(figure, text)
