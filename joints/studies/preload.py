"""`gpmodel joint preload`: the largest force [N] that the magnets of a spherical joint resist, against the joint angle,
and the choice of socket, magnet ring and magnet."""

from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path

import numpy as np

from joints import figures
from joints.magnets import (
    Magnet,
    MagnetSeat,
    PreloadDesign,
    PublishedPreload,
    continuous_optimum,
    published_preloads,
    rank_designs,
)
from joints.orifice import ATMOSPHERE
from joints.preload import (
    MagnetRing,
    cap_area,
    published_socket_area,
    socket_fixed_limit,
    three_contact_limit,
    total_preload,
)
from joints.settings import load_settings
from joints.studies.study import Study, Table

PSI = 6894.757293168


def preload_study(path: Path | None = None, seed: int = 0) -> Study:
    """Tabulate the preload, the largest pull at every angle and azimuth, and the designs of Tables 3.1 and 4.1."""
    s = load_settings("preload", path)
    seat = MagnetSeat(s["seat_radius"], s["magnet_clearance"], s["paired"])
    rings = [MagnetRing(**ring) for ring in s["ring"]]
    supports = [MagnetRing(**ring) for ring in s["contact_ring"]]
    seat.check(rings, s["socket_angle"])
    seat.check(supports, s["socket_angle"])
    preload, support_preload = total_preload(rings), total_preload(supports)

    angles = np.radians(np.linspace(0, 90, 181))
    azimuths = np.radians(np.arange(0, 360, 1.0))
    socket_fixed = socket_fixed_limit(preload, angles, s["reaction_angle"])
    limits = three_contact_limit(support_preload, angles[:, None], azimuths, s["contact_angle"])
    towards = three_contact_limit(support_preload, angles, 0.0, s["contact_angle"])

    wanted = s["optimisation"]
    magnets = [Magnet(**magnet) for magnet in wanted["magnet"]]
    designs = rank_designs(wanted["socket_angles"], wanted["ring_angles"], magnets, seat)[: wanted["keep"]]
    best = [continuous_optimum(magnet, seat, max(wanted["socket_angles"])) for magnet in magnets]

    published = published_preloads()
    data = {
        "preload_N": preload,
        "socket_fixed_worst_N": socket_fixed.min(),
        "socket_fixed_worst_share": socket_fixed.min() / preload,
        "socket_fixed_worst_angle_deg": np.degrees(angles[socket_fixed.argmin()]),
        "published_area_mm2": published_socket_area(seat.radius, s["socket_angle"]) * 1e6,
        "cap_area_mm2": cap_area(seat.radius, s["socket_angle"]) * 1e6,
        "contact_preload_N": support_preload,
        "contact_worst_towards_support": towards.min() / support_preload,
        "contact_worst_azimuth": limits.min() / support_preload,
        "designs": [_numbers(design) for design in designs],
        "continuous_optimum": [_numbers(design) for design in best],
        "published": [{**asdict(p), "stacked": p.stacked} for p in published],
    }
    return Study(
        (
            _pulls(preload, socket_fixed.min(), support_preload, (towards.min(), limits.min())),
            Table(
                "Designs on the grid, best first (Tables 3.1 and 4.1)",
                _HEADS,
                [_row(design) for design in designs],
                "published: area 4 alpha r^2; cap: 2 pi r^2 (1 - cos alpha)",
            ),
            Table("Best ring at any angle, in the smallest socket that holds it", _HEADS, [_row(d) for d in best]),
            _thesis(published),
        ),
        data,
        {
            "preload_sliding.png": figures.preload_sliding(angles, preload, socket_fixed),
            "preload_contacts.png": figures.preload_contacts(angles, support_preload, limits, towards),
            "preload_rings.png": figures.preload_rings(magnets, seat, best),
        },
    )


_HEADS = (
    "Socket [deg]", "Preload [N]", "Ring [deg]", "Magnet [mm]", "Count", "Cost [$]", "Area published [%]",
    "Pressure published [psi]", "[atm]", "Area cap [%]", "Pressure cap [psi]", "[atm] ",
)  # fmt: skip


def _pulls(preload: float, socket: float, support: float, rolling: tuple[float, float]) -> Table:
    """Tabulate the smallest limit of the pull on the sliding joint (ball or socket fixed) and on the rolling joint."""
    towards, anywhere = rolling
    fluid, point = "sliding, fluid", "point, rolling"
    return Table(
        "Largest pull before the joint separates",
        ("Joint", "Mounting", "At 0 deg [N]", "Worst [N]", "Worst / preload"),
        [
            (fluid, "ball fixed", preload, preload, 1.0),
            (fluid, "socket fixed", preload, socket, socket / preload),
            (point, "ball fixed", support, support, 1.0),
            (point, "socket fixed, towards a support", support, towards, towards / support),
            (point, "socket fixed, worst azimuth", support, anywhere, anywhere / support),
        ],
    )


def _thesis(published: Sequence[PublishedPreload]) -> Table:
    return Table(
        "Predicted and measured in the thesis (Figs 3.25, 3.30, 4.31)",
        ("Joint", "Predicted [N]", "Measured [N]", "Stack, computed", "Source"),
        [(p.name, p.predicted, "" if p.measured is None else p.measured, p.stacked, p.source) for p in published],
        "measured: empty where only a picture shows it, all within 10 %; "
        "stack: times one layer's pull, by the field of a cylinder",
    )


def _row(design: PreloadDesign) -> tuple[object, ...]:
    return tuple(_numbers(design).values())


def _numbers(design: PreloadDesign) -> dict[str, float]:
    return {
        "socket_angle_deg": float(np.degrees(design.socket_angle)),
        "preload_N": design.preload,
        "ring_angle_deg": float(np.degrees(design.ring.angle)),
        "magnet_mm": design.magnet.diameter * 1e3,
        "count": design.ring.count,
        "cost": design.cost,
        "published_area_percent": design.published_area_ratio * 100,
        "published_pressure_psi": design.published_pressure / PSI,
        "published_pressure_atm": design.published_pressure / ATMOSPHERE,
        "cap_area_percent": design.area_ratio * 100,
        "cap_pressure_psi": design.pressure / PSI,
        "cap_pressure_atm": design.pressure / ATMOSPHERE,
    }
