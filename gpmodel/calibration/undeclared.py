"""Separate constants from undeclared effects in measurements without an instrument's frame.

Within the measured region, constants can imitate an undeclared effect; outside, predictions differ. Measurements r obey

    r = F ρ + A θ + Σ_a c_a ∘ f_a(q) + e,   θ ~ N(0, τ² I),   f_a ~ N(0, γ_a² K),   e ~ N(0, n² I)

where f_a are unknown smooth functions of the joint values q and e is the noise. c_a, A, F are the derivatives of r with
respect to axis a, to all constants θ, and to registration, tool and declared effects ρ. γ_a, τ and n maximise the
restricted likelihood. Constants are fitted by generalised least squares with the covariance V of functions and noise.
The conditional mean of the functions becomes a part of the model, with α = V⁻¹ (r - F ρ - A θ):

    f_a(q) = γ_a² Σ_m K(q, q_m) c_a,m α_m

Sources: Kennedy and O'Hagan (2001), Bayesian calibration of computer models; Patterson and Thompson (1971); Zhou, Hu,
Zhou and Lange (2019), MM algorithms for variance components models.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import combinations, product

import numpy as np
from scipy import linalg

from gpmodel.arrays import Array, Mask
from gpmodel.calibration.gauss_newton import fitting_of
from gpmodel.calibration.iterate import Fitted, Fitting, iterate, linear_step
from gpmodel.calibration.linearise import Linearised
from gpmodel.calibration.overall_scale import LEAST, MOST, TOLERANCE, nominal_constants, without_positions
from gpmodel.calibration.result import Calibration, uncertainty
from gpmodel.calibration.start import placement_after
from gpmodel.formula.expression import Expression
from gpmodel.model.effect import Effect
from gpmodel.model.error_model import ErrorModel, Poses, pose_error
from gpmodel.model.sites import geometric_effects
from gpmodel.numerics import rank

MEAN, OF_ONE, OF_TWO = 0.3, ((0.3, 1.5), (0.1, 4.0)), (0.3, 1.5)
"""Variances of the parts of an unknown function of variance about 1: mean; sinusoids of one joint, with rates, rad over
its range; products of sinusoids of two joints. A load hardly changes over a table, so most of an effect is its mean;
without a mean, constants absorb it and touches leave arms less accurate outside their region than the nominal geometry.
With other variances and rates from 1 to 4.5 the error outside is up to double on planes, within a fifth elsewhere."""
MOST_ROWS, LARGEST = 400, 3000
"""Number of measurements, drawn evenly along the rows, from which variances are estimated; largest number whose
covariance is inverted. With more measurements, the noise is taken as white."""
STEPS = 20
"""Number of iterations that estimate variances; with 40 no constant changes by a tenth of its standard error."""
PASSES = 3
"""Number of generalised least-squares steps after an ordinary fit; a third step moves no measurement by 0.1 µm."""
SHOWN = 0.1
"""Least RMS displacement of measurements by an unknown function, in units of noise; smaller functions are omitted."""
MOST_WAVES, FAINT = 200, 1e-2
"""Largest number of sinusoids that express an unknown function, and their least size relative to the largest."""
SMOOTH, UNDECLARED = "smooth functions of the joint values", "undeclared"
"""Name and family of the effect that adds the undeclared functions to a model. The unknown of the effect is a factor, 1
for the estimated functions."""
ALONE_STEPS = 200
"""Number of iterations for τ (constants) and n (noise); 100 iterations change the log likelihood by less than 0.001."""
EARNED = 20.0
"""Least gain in log evidence at which undeclared effects are reported, nats. The largest gain of 56 tables of touches
and cameras without an undeclared effect was 11 nats, the least of eight with a compliant joint and two oval gears 38
nats. Half the limit reports one more table of pure noise; double the limit misses one table with an effect."""
START, SMALLEST = (1e-4, 3e-4, 0.3), 1e-8
"""Initial standard deviations γ and τ, m and rad, and initial share of noise in the measurements; smallest γ and n."""


@dataclass(frozen=True)
class Undeclared:
    """Standard deviations of undeclared effects, of constants and of the noise.

    sizes: standard deviation γ of the unknown function at each axis of `geometric_effects`, m and rad.
    constant: standard deviation τ of a constant, m and rad.
    noise: standard deviation n of a measurement, m.
    gain: increase of the log restricted likelihood by the functions, nats.
    """

    sizes: Array
    constant: float
    noise: float
    gain: float

    @classmethod
    def estimated(cls, problem: Linearised, model: ErrorModel, theta: Array) -> "Undeclared":
        """Estimate the standard deviations of functions, constants and noise by their restricted likelihood."""
        rows = np.linspace(0, len(problem.residual) - 1, min(len(problem.residual), MOST_ROWS)).astype(int)
        axes, constant = _axes(problem, model)[rows], nominal_constants(model)
        effects, added = problem.columns[rows, problem.placement :], constant | _smooth(model)
        taken = rank.orthonormal(np.hstack([problem.columns[rows, : problem.placement], effects[:, ~added]]))
        rest = np.linalg.qr(taken, mode="complete")[0][:, taken.shape[1] :]
        known = rest.T @ (problem.residual[rows] + effects[:, added] @ theta[added])
        values = SinusoidProducts.of(problem, model).values(problem.poses.dataset.q[problem.pose_of_row[rows]])
        kernel, shown = values @ values.T, rest.T @ axes
        like = shown @ shown.T
        varying, reach = np.full(axes.shape[1], START[0] ** 2), START[1] ** 2
        noise = START[2] ** 2 * float(np.mean(known**2)) + SMALLEST**2
        for _ in range(STEPS):
            varied = rest.T @ (((axes * varying) @ axes.T) * kernel) @ rest
            inverse = np.linalg.inv(varied + reach * like + noise * np.eye(len(known)))
            pulled = inverse @ known
            along, spread = (rest @ pulled)[:, None] * axes, (rest @ inverse @ rest.T) * kernel
            found = np.sum(along * (kernel @ along), axis=0), np.sum(axes * (spread @ axes), axis=0)
            varying = np.maximum(varying * np.sqrt(found[0] / np.maximum(found[1], 1e-300)), SMALLEST**2)
            reach *= np.sqrt((pulled @ like @ pulled) / max(float(np.sum(inverse * like)), 1e-300))
            reach = float(np.clip(reach, LEAST**2, MOST**2))
            noise = max(noise * float(np.sqrt((pulled @ pulled) / np.trace(inverse))), SMALLEST**2)
        whole = rest.T @ (((axes * varying) @ axes.T) * kernel) @ rest + reach * like + noise * np.eye(len(known))
        gain = _likelihood(whole, known) - _without_functions(like, known)
        return cls(np.sqrt(varying), float(np.sqrt(reach)), float(np.sqrt(noise)), gain)

    @property
    def significant(self) -> bool:
        """True if unknown functions increase the log restricted likelihood by more than 20 nats (EARNED)."""
        return self.gain > EARNED

    def covariance(self, problem: Linearised, model: ErrorModel) -> "UndeclaredCovariance":
        """Return the covariance of the measurements by undeclared effects (unknown functions) and noise."""
        waves = SinusoidProducts.of(problem, model)
        values = waves.values(problem.poses.dataset.q)[problem.pose_of_row]
        axes = _axes(problem, model) * self.sizes / self.noise
        lower = np.asarray(np.linalg.cholesky((axes @ axes.T) * (values @ values.T) + np.eye(len(axes))), dtype=float)
        return UndeclaredCovariance(self, waves, axes, values, lower)


@dataclass(frozen=True)
class UndeclaredCovariance:
    """Covariance n² L Lᵀ of the measurements by noise n and undeclared effects (unknown functions), Cholesky factor L.

    axes: displacement of each measurement per unit of each axis, times γ / n (standard deviation of the function).
    values: products of sinusoids of the joint values at each measurement.
    lower: Cholesky factor L of the covariance.
    """

    deviations: Undeclared
    sinusoids: "SinusoidProducts"
    axes: Array
    values: Array
    lower: Array

    def whiten(self, problem: Linearised) -> Linearised:
        """Transform the linear problem to independent rows, each with the variance of the noise."""
        columns, residual = (self._solved(values) for values in (problem.columns, problem.residual))
        ratio = self.deviations.noise / min(self.deviations.constant, TOLERANCE)
        return replace(problem, columns=columns, residual=residual, ratio=ratio)

    def posterior_mean(self, white: Array, model: ErrorModel) -> Effect | None:
        """Return the conditional mean of the unknown functions, as an effect, given the whitened residual `white`.

        The effect is None if every unknown function moves the measurements by an RMS below a tenth of the noise.
        The effect's prior is the standard deviation of the functions relative to their mean, both RMS over the
        measurements.
        """
        pulled = linalg.solve_triangular(self.lower, white, lower=True, trans="T", check_finite=False)
        weights = self.values.T @ (self.axes * pulled[:, None])
        moved = self.axes * (self.values @ weights)
        least = SHOWN * self.deviations.noise * np.sqrt(len(white))
        scaled, places = weights * self.deviations.sizes / self.deviations.noise, geometric_effects(model.mechanism)
        terms = tuple(
            replace(places[k].terms[0], basis=Expression(self.sinusoids.text(scaled[:, k])))
            for k in np.flatnonzero(np.linalg.norm(moved, axis=0) > least)
        )
        share = self.determined * self.deviations.noise**2 / max(float(np.sum(moved.sum(axis=1) ** 2)), SMALLEST**2)
        return Effect(SMOOTH, terms, "1", UNDECLARED, prior=float(np.sqrt(share)), mean=1.0) if terms else None

    @property
    def determined(self) -> float:
        """Effective number of parameters of the unknown functions of undeclared effects."""
        return len(self.lower) - float(np.sum(self._solved(np.eye(len(self.lower))) ** 2))

    def posterior_variance(self, q: Array, axes: Array, columns: Array, fit: Calibration, fitted: Linearised) -> Array:
        """Return the posterior variance of predicted points, m², by fitted unknowns and unknown functions together.

        axes, columns: derivatives of the points with respect to the functions' axes and the unknowns. q: joint values.
        fitted: problem of the fit. The variance of an unknown that functions absorb counts once (universal kriging).
        """
        unknowns, out = fit.covariance.values, np.sum((axes * self.deviations.sizes) ** 2, axis=(1, 2))
        for k in range(3):
            explained = self._explained(q, axes[:, k])
            own = columns[:, k] - self._made_up(explained, fitted)
            out += np.sum((own @ unknowns) * own, axis=1) - np.sum(explained**2, axis=0)
        return np.asarray(np.maximum(out, 0.0))

    def posterior_root(self, problem: Linearised, model: ErrorModel, fitted: Linearised) -> tuple[Array, Array]:
        """Return a square root, m, of the posterior covariance that the unknown functions cause in new measurements.

        A second result is the share of each fitted unknown that unknown functions absorb at new measurements.
        """
        q, columns = problem.poses.dataset.q[problem.pose_of_row], _axes(problem, model)
        at, there = columns * self.deviations.sizes, self.sinusoids.values(q)
        explained = self._explained(q, columns)
        root = rank.square_root((at @ at.T) * (there @ there.T) - explained.T @ explained)
        return root, self._made_up(explained, fitted)

    def _made_up(self, explained: Array, fitted: Linearised) -> Array:
        return np.asarray(explained.T @ self._solved(fitted.columns) / self.deviations.noise)

    def _explained(self, q: Array, columns: Array) -> Array:
        """Return L⁻¹ times the covariance, m, of fitted and new measurements, with L the covariance factor of the fit.
        q: joint values of the new measurements. columns: displacement of the new measurements per unit of each axis."""
        there = self.sinusoids.values(q) @ self.values.T
        return self._solved((((columns * self.deviations.sizes) @ self.axes.T) * there).T)

    def _solved(self, values: Array) -> Array:
        return np.asarray(linalg.solve_triangular(self.lower, values, lower=True, check_finite=False))


Wave = tuple[str, int, float]
"""Sinusoid of a joint value: function (sin or cos), index of the joint, and rate, rad per unit of the joint."""


@dataclass(frozen=True)
class SinusoidProducts:
    """Products of sinusoids of the joint values q; their weighted sum is the unknown error f(q) along one axis.

    names: joint names.
    sizes: standard deviation of the coefficient of each product.
    parts: the sinusoids (of one or two joints) of each product.
    """

    names: tuple[str, ...]
    sizes: Array
    parts: tuple[tuple[Wave, ...], ...]

    @classmethod
    def of(cls, problem: Linearised, model: ErrorModel) -> "SinusoidProducts":
        """Return the products of sinusoids for the joint ranges of the measured poses."""
        span = np.ptp(problem.poses.dataset.q, axis=0)
        moving = np.flatnonzero(span > 0).tolist()
        products: list[tuple[float, tuple[Wave, ...]]] = [(MEAN, ())]
        for share, rate in OF_ONE:
            products += [(share / len(moving), (wave,)) for j in moving for wave in _waves(j, rate / span[j])]
        share, rate = OF_TWO
        for i, j in combinations(moving, 2):
            count = len(moving) * (len(moving) - 1) / 2
            both = product(_waves(i, rate / span[i]), _waves(j, rate / span[j]))
            products += [(share / count, pair) for pair in both]
        shares, parts = zip(*products, strict=True)
        return cls(tuple(j.name for j in model.mechanism.joints), np.sqrt(np.array(shares)), parts)

    def values(self, q: Array) -> Array:
        """Return the products of sinusoids at joint values, each times its standard deviation."""
        out = np.tile(self.sizes, (len(q), 1))
        for k, waves in enumerate(self.parts):
            for name, joint, rate in waves:
                out[:, k] *= (np.sin if name == "sin" else np.cos)(rate * q[:, joint])
        return out

    def text(self, weights: Array) -> str:
        """Write the weighted sum of the products of sinusoids as an expression; small terms are omitted."""
        signed = weights * self.sizes
        sizes = np.abs(signed)
        largest = np.sort(np.argsort(-sizes)[:MOST_WAVES]).tolist()
        terms = [
            "*".join([f"{signed[k]:.6g}", *(f"{f}({r!r}*{self.names[j]})" for f, j, r in self.parts[k])])
            for k in largest
            if sizes[k] > FAINT * sizes.max()
        ]
        return _sum(terms)


def _waves(joint: int, rate: float) -> tuple[Wave, Wave]:
    rounded = float(f"{rate:.6g}")
    return ("sin", joint, rounded), ("cos", joint, rounded)


def _sum(terms: Sequence[str]) -> str:
    """Write a sum of n terms as nested halves, so that parentheses nest only log2 n deep."""
    half = len(terms) // 2
    return terms[0] if len(terms) == 1 else f"({_sum(terms[:half])}) + ({_sum(terms[half:])})"


def _likelihood(covariance: Array, known: Array) -> float:
    """Return the log density of normal values of mean zero with a covariance, up to a constant."""
    lower = np.linalg.cholesky(covariance)
    return -float(np.log(np.diag(lower)).sum() + 0.5 * np.sum(np.linalg.solve(lower, known) ** 2))


def _without_functions(like: Array, known: Array) -> float:
    """Return the largest log density of normal values of covariance τ² `like` + n² I, over τ and n."""
    values, vectors = np.linalg.eigh(like)
    squares, values = (vectors.T @ known) ** 2, np.maximum(values, 0.0)
    reach, noise = START[1] ** 2, START[2] ** 2 * float(np.mean(known**2)) + SMALLEST**2
    for _ in range(ALONE_STEPS):
        variance = reach * values + noise
        reach *= np.sqrt((values @ (squares / variance**2)) / max(float(np.sum(values / variance)), 1e-300))
        reach = float(np.clip(reach, LEAST**2, MOST**2))
        noise = max(noise * float(np.sqrt(np.sum(squares / variance**2) / np.sum(1.0 / variance))), SMALLEST**2)
    variance = reach * values + noise
    return -0.5 * float(np.sum(np.log(variance) + squares / variance))


def _axes(problem: Linearised, model: ErrorModel) -> Array:
    return problem.effect_rows(geometric_effects(model.mechanism), model)


def uncertain_functions(model: ErrorModel, fitted: Linearised, theta: Array, other: Linearised) -> tuple[Array, Array]:
    """Return the posterior covariance root, m, and shares of `posterior_root` for a model's undeclared effects.

    fitted: linear problem of the fit, at effects `theta`. other: linear problem of new measurements.
    """
    return Undeclared.estimated(fitted, model, theta).covariance(fitted, model).posterior_root(other, model, fitted)


def has_functions(model: ErrorModel) -> bool:
    """Return whether a model contains functions of undeclared effects."""
    return bool(_smooth(model).any())


def _smooth(model: ErrorModel) -> Mask:
    return np.array([effect.family == UNDECLARED for effect in model.effects], dtype=bool)


def apart_from_effects(fit: Calibration, poses: Poses) -> Calibration:
    """Refit constants separately from undeclared effects, and add the undeclared effects to the model.

    The calibration is returned unchanged if a measured position is in an instrument's frame. The variance sigma² is the
    variance of the noise plus the mean variance of the functions over the measurements.
    """
    fitting = fitting_of(fit, poses)
    raw = fitting.at(fit.theta, fit.placement)
    if not without_positions(raw) or not nominal_constants(fit.model).any() or len(raw.residual) > LARGEST:
        return fit
    unknown = Undeclared.estimated(raw, fit.model, fit.theta)
    known = unknown.covariance(raw, fit.model)
    again, white = _generalised(fitting, known, fit)
    effect = known.posterior_mean(white, fit.model)
    if effect is not None:
        model, theta = replace(fit.model, effects=(*fit.model.effects, effect)), np.append(again.theta, 0.0)
        fit, fitting = replace(fit, model=model, free=np.append(fit.free, True)), replace(fitting, model=model)
        problem = replace(known.whiten(fitting.at(theta, again.placement)), residual=white)
        again = replace(again, theta=np.append(again.theta, 1.0), problem=problem)
    told = uncertainty(fitting, again, fit.free)
    placed = iterate(fitting, again.theta, again.placement, np.zeros_like(fit.free))
    sigma = unknown.noise * float(np.sqrt(1.0 + known.determined / len(white)))
    return replace(
        fit, **vars(told) | {"sigma": sigma}, theta=again.theta, placement=placed.placement,
        error=pose_error(placed.problem.observed, poses.dataset, fit.weights), status=placed.status,
    )  # fmt: skip


def _generalised(fitting: Fitting, known: UndeclaredCovariance, fit: Calibration) -> tuple[Fitted, Array]:
    """Fit all parameters by generalised least squares from an ordinary fit; return values and whitened residual.

    The unknowns of the instruments are solved for again at every least-squares step.
    """
    theta, placement = fit.theta, fit.placement
    for _ in range(PASSES):
        problem = known.whiten(fitting.at(theta, placement))
        linear = linear_step(fit.model, problem, theta, placement, fit.free, None)
        step, _ = linear.solved(problem.residual, linear.pulls)
        left = problem.residual - problem.columns @ step
        theta = theta + step[problem.placement :]
        placement = placement_after(problem.observed, placement, step[: problem.placement])
    return Fitted(placement, theta, replace(problem, residual=left), "converged"), left
