"""A regression of what a standard calibration leaves, each coordinate by itself: pip install scikit-learn pyoperon."""

from __future__ import annotations

import os
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pandas as pd

import gpmodel as gp
from experiments.blind.simulator import Array
from experiments.methods.plug import POSITION, predicted
from gpmodel.table.units import split_header

SECONDS = float(os.environ.get("SYMBOLIC_SECONDS", "30"))
"""Seconds of symbolic regression for one coordinate."""
Regression = Callable[[Array, Array], Callable[[Array], Array]]


def inputs(table: Path, scale: pd.DataFrame) -> Array:
    """(N, D) joint values and readings of a table, each over its range in `scale`."""
    frame = pd.read_csv(table)[list(scale.columns)]
    low, high = scale.min(), scale.max()
    return ((2 * frame - low - high) / (high - low).where(high > low, 1.0)).to_numpy()


def read_by(poses: Path, table: Path) -> pd.DataFrame:
    """The columns of the table that other poses have, too."""
    return pd.read_csv(table)[[c for c in pd.read_csv(poses).columns if split_header(c)[0] != "repeat"]]


def of_the_rest(regression: Regression, table: Path, urdf: Path, poses: Path) -> Array:
    """The standard model, and a regression of what it leaves of every coordinate of the instrument."""
    model = gp.calibrate(urdf, table, holdout=0.0).model
    scale = read_by(poses, table)
    here, there = inputs(table, scale), inputs(poses, scale)
    left = 1e-3 * pd.read_csv(table)[POSITION].to_numpy() - predicted(model, table)
    rest = [regression(here, 1e3 * column)(there) for column in left.T]
    return predicted(model, poses) + 1e-3 * np.column_stack(rest)


def gaussian_process(table: Path, urdf: Path, poses: Path) -> Array:
    """Gaussian kernel, a length an input, and noise, by marginal likelihood (scikit-learn)."""
    from sklearn.gaussian_process import GaussianProcessRegressor
    from sklearn.gaussian_process.kernels import RBF, ConstantKernel, WhiteKernel

    def regression(columns: Array, response: Array) -> Callable[[Array], Array]:
        size = float(response.std())
        kernel = ConstantKernel(size**2, (1e-3 * size**2, 1e3 * size**2)) * RBF(
            np.full(columns.shape[1], 2.0), (0.05, 1e3)
        ) + WhiteKernel(0.1 * size**2, (1e-4 * size**2, 10 * size**2))
        model = GaussianProcessRegressor(kernel, n_restarts_optimizer=1, random_state=0)
        return model.fit(columns, response).predict

    return of_the_rest(regression, table, urdf, poses)


def symbolic_regression(table: Path, urdf: Path, poses: Path) -> Array:
    """Operon (Burlacu, Kronberger, Kommenda 2020) with Levenberg-Marquardt steps; its front by description length."""
    from pyoperon.sklearn import SymbolicRegressor

    def regression(columns: Array, response: Array) -> Callable[[Array], Array]:
        model = SymbolicRegressor(
            allowed_symbols="add,sub,mul,div,sin,cos,exp,log,sqrt,square,tanh,abs,constant,variable",
            optimizer_iterations=10, population_size=1000, pool_size=1000, max_length=30, objectives=["r2", "length"],
            model_selection_criterion="minimum_description_length", generations=1_000_000, max_evaluations=10**9,
            max_time=round(SECONDS), n_threads=1, random_state=0,
        )  # fmt: skip
        return model.fit(columns, response).predict

    return of_the_rest(regression, table, urdf, poses)
