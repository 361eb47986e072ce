"""Figures of the studies of the spherical joint, drawn without a display."""

from collections.abc import Callable, Mapping, Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.typing import NDArray

from gpmodel.arrays import Array
from joints.contact import HertzContact, PublishedContact
from joints.film import Film, FilmDesign, FilmGeometry, supporting_pressure
from joints.film import film_pressure as flat_pressure
from joints.magnets import Magnet, MagnetSeat, PreloadDesign
from joints.orifice import ATMOSPHERE, SCCM
from joints.reynolds import compressible_film, spherical_area, spherical_pressure
from joints.stiffness import RegimeCurve


def _axes(columns: int = 1, width: float = 6.0) -> tuple[Figure, list[Axes]]:
    figure = Figure(figsize=(width * columns, 4.0), layout="constrained")
    axes = [figure.add_subplot(1, columns, i + 1) for i in range(columns)]
    for ax in axes:
        ax.grid(alpha=0.3)
    return figure, axes


def preload_sliding(angles: Array, preload: float, socket_fixed: Array) -> Figure:
    """Plot the largest pull that the preload resists against the joint angle, with ball or socket fixed (Fig 3.9)."""
    figure, (ax,) = _axes()
    degrees = np.degrees(angles)
    ax.plot(degrees, np.full_like(degrees, preload), label="ball fixed")
    ax.plot(degrees, socket_fixed, label="socket fixed")
    ax.set(xlabel="joint angle [deg]", ylabel="largest pull [N]", ylim=(0, 1.2 * preload))
    ax.set_title("Sliding and fluid contact")
    ax.legend()
    return figure


def preload_contacts(angles: Array, preload: float, limits: Array, towards: Array) -> Figure:
    """Plot the largest pull on a ball on three supports against the joint angle (Fig 3.11): for all azimuths of the
    pull, for a pull towards a support, and for the worst azimuth."""
    figure, (ax,) = _axes()
    degrees = np.degrees(angles)
    top = np.minimum(limits.max(axis=1), 2 * preload)
    ax.fill_between(degrees, limits.min(axis=1), top, alpha=0.2, label="all azimuths")
    ax.axhline(preload, color="C2", label="ball fixed")
    ax.plot(degrees, towards, label="pulled towards a support (Fig 3.11)")
    ax.plot(degrees, limits.min(axis=1), label="worst azimuth")
    ax.set(xlabel="joint angle [deg]", ylabel="largest pull [N]", ylim=(0, 2 * preload))
    ax.set_title("Point and rolling contact, socket fixed")
    ax.legend()
    return figure


def preload_rings(magnets: Sequence[Magnet], seat: MagnetSeat, best: Sequence[PreloadDesign]) -> Figure:
    """Plot the preload of a magnet ring with as many magnets as fit, against its polar angle (Fig 3.10)."""
    figure, (ax,) = _axes()
    angles = np.radians(np.linspace(5, 85, 1601))
    for magnet, design in zip(magnets, best, strict=True):
        counts = [seat.fitting_count(magnet.diameter, angle) for angle in angles]
        (line,) = ax.plot(
            np.degrees(angles), np.array(counts) * np.cos(angles) * magnet.force, label=f"{magnet.diameter * 1e3:g} mm"
        )
        ax.plot(np.degrees(design.ring.angle), design.preload, "o", color=line.get_color())
        ax.annotate(
            f"{design.ring.count} magnets, {design.preload:.1f} N",
            (np.degrees(design.ring.angle), design.preload),
            textcoords="offset points",
            xytext=(6, 6),
        )
    ax.set(xlabel="ring angle [deg]", ylabel="preload of the fullest ring [N]")
    ax.set(ylim=(0, 1.2 * max(design.preload for design in best)), title="Preload against ring angle")
    ax.legend(title="magnet")
    return figure


def contact(force: Array, printed: PublishedContact, exact: HertzContact, first_yield: float) -> Figure:
    """Plot approach and peak pressure of a Hertz contact against force: as printed in the thesis, and exact."""
    figure, (left, right) = _axes(2, 5.0)
    left.plot(force, exact.approach * 1e6, label="exact")
    left.plot(force, printed.approach * 1e6, "--", label="as printed (cylinders)")
    left.set(xlabel="force [N]", ylabel="approach [um]", title="Hertz approach")
    left.legend()
    right.semilogy(force, exact.pressure * 1e-9, label="exact")
    right.semilogy(force, printed.pressure * 1e-9, "--", label="as printed (cylinders)")
    right.axhline(first_yield * 1e-9, color="C3", label="first yield")
    right.set(xlabel="force [N]", ylabel="peak pressure [GPa]", title="Peak pressure")
    right.legend()
    return figure


def thermal(per_kelvin: Mapping[str, float], change: float, tolerance: float) -> Figure:
    """Plot the thermal growth of every part over the temperature change, and the tolerance of the growth."""
    figure, (ax,) = _axes(1, 7.0)
    names = list(per_kelvin)
    ax.barh(names, [rate * change * 1e6 for rate in per_kelvin.values()])
    for sign in (-1, 1):
        ax.axvline(sign * tolerance * 1e6, color="C3", linestyle="--", label="tolerance" if sign > 0 else None)
    ax.invert_yaxis()
    ax.set(xlabel="growth [um]", title=f"Thermal growth over {change:g} K")
    ax.legend()
    return figure


def film_guide(flat: FilmDesign, sphere: Film) -> Figure:
    """Plot flow and stiffness of the air film against displacement, for the flat-plate and the spherical model."""
    figure, (left, right) = _axes(2, 5.5)
    lift = flat.displacement * 1e6
    left.plot(lift, flat.flow / SCCM, label="flat plate (Table 4.2)")
    left.plot(lift, sphere.flow / SCCM, label="sphere")
    left.set(xlabel="displacement [um]", ylabel="flow per orifice [sccm]", yscale="log", title="Flow")
    left.legend()
    right.plot(lift, flat.published_stiffness * 1e-6, "--", label="flat plate, as printed")
    right.plot(lift, flat.stiffness_constant_flow * 1e-6, label="flat plate, constant flow")
    right.plot(lift, flat.stiffness_constant_inlet * 1e-6, label="flat plate, constant inlet")
    right.plot(lift, sphere.stiffness_constant_flow * 1e-6, label="sphere, constant flow")
    right.plot(lift, sphere.stiffness_constant_inlet * 1e-6, label="sphere, constant inlet")
    right.axhline(4.5, color="k", linestyle=":", label="measured (Table 4.3)")
    right.set(xlabel="displacement [um]", ylabel="stiffness [N/um]", ylim=(0, None), title="Stiffness")
    right.legend(fontsize="small")
    return figure


def film_inlet(inlet: Array, lift: Array, gap: Array, sphere: Film) -> Figure:
    """Plot displacement of the ball and gap at the socket's edge against inlet pressure (Figs 4.21 and 4.22)."""
    figure, (ax,) = _axes()
    ax.plot(inlet / ATMOSPHERE, lift * 1e6, label="displacement, flat plate")
    ax.plot(inlet / ATMOSPHERE, gap * 1e6, "--", color="C0", label="edge gap, flat plate")
    ax.plot(sphere.inlet_pressure / ATMOSPHERE, sphere.displacement * 1e6, label="displacement, sphere")
    ax.set(xlabel="inlet pressure above atmosphere [atm]", ylabel="[um]")
    highest = 1.1 * lift[-1] * 1e6 or None
    ax.set(xlim=(0, inlet[-1] / ATMOSPHERE), ylim=(0, highest), title="Lift against inlet pressure")
    ax.legend()
    return figure


def film_pressure(geometry: FilmGeometry, load: float, displacement: float) -> Figure:
    """Plot the film pressure from axis to edge for three models: flat plate, sphere, sphere with compressible air."""
    figure, (ax,) = _axes()
    angle = np.linspace(1e-3, geometry.socket_angle, 300)
    degrees = np.degrees(angle)
    arc = geometry.outer_length * angle / geometry.socket_angle
    flat = flat_pressure(geometry, supporting_pressure(geometry, load), arc)
    steady = load / float(spherical_area(geometry, displacement))
    _, squeezed = compressible_film(geometry, load, displacement)
    ax.plot(degrees, flat / ATMOSPHERE, label="flat plate")
    for socket, compressible, name in ((steady, False, "sphere"), (squeezed, True, "sphere, compressible")):
        pressure = spherical_pressure(geometry, displacement, socket, angle, compressible)
        ax.plot(degrees, pressure / ATMOSPHERE, label=name)
    ax.set(xlabel="polar angle [deg]", ylabel="pressure above atmosphere [atm]", ylim=(0, None))
    ax.set_title(f"Film pressure at {displacement * 1e6:g} um, {load:g} N")
    ax.legend()
    return figure


def stiffness_predicted(displacement: Array, curves: Mapping[str, Array], rest: float) -> Figure:
    """Plot the tension on the ball against its displacement, with air on and off (Figs 4.14 and 4.28)."""
    figure, (ax,) = _axes()
    for name, force in curves.items():
        ax.plot(displacement * 1e6, force, label=name)
    ax.axvline(rest * 1e6, color="k", linestyle=":", label=f"rest at {rest * 1e6:.1f} um")
    ax.axhline(0.0, color="k", linewidth=0.8)
    peak = max(float(force.max()) for force in curves.values())
    ax.set(xlabel="displacement from contact [um]", ylabel="tension [N]", ylim=(-2 * peak, 1.2 * peak))
    ax.set_title("Magnet, film and contact, predicted")
    ax.legend()
    return figure


def stiffness_regimes(displacement: Array, force: Array, curve: RegimeCurve, source: str) -> Figure:
    """Plot the measured force-displacement curve and its four fitted regimes (Fig 4.15)."""
    figure, (ax,) = _axes(1, 7.0)
    ax.plot(displacement * 1e6, force, ".", color="0.6", markersize=3, label=source)
    limits = (displacement.min(), curve.contact_end, curve.transition_end, curve.film_end, displacement.max())
    for name, low, high in zip(("contact", "transition", "film", "magnet"), limits, limits[1:], strict=False):
        x = np.linspace(low, high, 100)
        ax.plot(x * 1e6, curve.force(x), linewidth=2, label=name)
    ax.axhline(0.0, color="k", linewidth=0.8)
    ax.set(xlabel="displacement [um]", ylabel="tension [N]", title="Stiffness regimes")
    ax.legend()
    return figure


def design_lift(inlets: Array, lift: Array, supply: float, wanted: float) -> Figure:
    """Plot the lift of the ball against inlet pressure, with the available supply pressure and the required lift."""
    figure, (ax,) = _axes(1, 5.5)
    ax.plot(inlets / ATMOSPHERE, lift * 1e6, label="flat film")
    ax.axvline(supply / ATMOSPHERE, color="k", linestyle="--", linewidth=0.8, label="supply")
    ax.axhline(wanted * 1e6, color="0.5", linestyle=":", label="wanted")
    ax.set(xlabel="inlet pressure [atm]", ylabel="lift [um]", title="Lift on the air film")
    ax.legend()
    return figure


def dynamics(
    frequency: Array,
    responses: Mapping[str, NDArray[np.complex128]],
    measured: tuple[Array, NDArray[np.complex128], str],
) -> Figure:
    """Plot amplitude [um/N] and phase [deg] of the measured and computed compliance against frequency."""
    figure, (left, right) = _axes(2, 5.5)
    points, response, source = measured
    left.loglog(points, np.abs(response) * 1e6, ".", color="0.7", label=source)
    for name, values in responses.items():
        left.loglog(frequency, np.abs(values) * 1e6, label=name)
        right.semilogx(frequency, np.degrees(np.unwrap(np.angle(values))), label=name)
    left.set(xlabel="frequency [Hz]", ylabel="compliance [um/N]", title="Compliance")
    right.set(xlabel="frequency [Hz]", ylabel="phase [deg]", title="Phase")
    left.legend(fontsize="small")
    return figure


def drawn(width: float, chart: Callable[..., None], *content: object) -> Figure:
    """Draw a chart on a new figure of `width` inches."""
    figure = Figure(figsize=(width, 4.0), layout="constrained")
    chart(figure, *content)
    return figure
