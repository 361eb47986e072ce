"""Fit each coordinate of the residual of a calibration by a Gaussian process or by Operon."""

from __future__ import annotations

import json
import os
import tempfile
from collections.abc import Callable
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
import pandas as pd
from scipy.optimize import least_squares
from scipy.spatial.transform import Rotation

import gpmodel as gp
from experiments.blind.simulator import Array
from experiments.methods.plug import POSITION, predicted
from gpmodel.api.table import dataset_of
from gpmodel.table.units import split_header

STEPS = 40
"""Steps of pybotics' fit at most."""


def denavit_hartenberg(urdf: Path) -> tuple[Array, list[bool]]:
    """(n, 4) alpha, a [mm], theta, d [mm] of a description whose origins are Rx(alpha) Tx(a) Tz(d) Rz(theta), and which
    joints slide."""
    rows, slides = [], []
    for joint in ElementTree.parse(urdf).getroot().iter("joint"):
        origin = joint.find("origin")
        assert origin is not None
        xyz, rpy = (np.array(origin.attrib[name].split(), dtype=float) for name in ("xyz", "rpy"))
        turned = Rotation.from_euler("xyz", rpy).as_matrix()
        alpha, theta = np.arctan2(-turned[1, 2], turned[2, 2]), np.arctan2(-turned[0, 1], turned[0, 0])
        rows.append([alpha, 1e3 * xyz[0], theta, 1e3 * (xyz[2] * np.cos(alpha) - xyz[1] * np.sin(alpha))])
        slides.append(joint.attrib["type"] == "prismatic")
    return np.array(rows), slides


def pybotics(table: Path, urdf: Path, poses: Path) -> Array:
    """Modified Denavit-Hartenberg rows, tool point and base by pybotics' own distances, from a rigid registration."""
    from pybotics.kinematic_chain import MDHKinematicChain
    from pybotics.link import PrismaticMDHLink, RevoluteMDHLink
    from pybotics.optimization import OptimizationHandler, optimize_accuracy
    from pybotics.robot import Robot
    from pybotics.tool import Tool

    start = gp.calibrate(urdf, table, standard=("none",), holdout=0.0).model.saved.placement
    (world,), (tool,) = start.registration.values(), start.tool.values()
    in_mm = np.diag([1e3, 1e3, 1e3, 1.0])
    to_mm = [in_mm @ frame @ np.linalg.inv(in_mm) for frame in (world, tool)]
    rows, slides = denavit_hartenberg(urdf)
    links = [(PrismaticMDHLink if s else RevoluteMDHLink)(*row) for row, s in zip(rows, slides, strict=True)]
    robot = Robot(MDHKinematicChain(links), tool=Tool(to_mm[1]), world_frame=to_mm[0])
    handler = OptimizationHandler(robot, True, [True] * 3 + [False] * 3, True)
    q, fresh = (joints(file, urdf) * np.where(slides, 1e3, 1.0) for file in (table, poses))
    measured = pd.read_csv(table)[POSITION].to_numpy()
    found = least_squares(
        optimize_accuracy, handler.generate_optimization_vector(), args=(handler, q, measured), x_scale="jac",
        max_nfev=STEPS,
    )  # fmt: skip
    handler.apply_optimization_vector(found.x)
    return 1e-3 * np.array([handler.robot.fk(pose)[:3, 3] for pose in fresh])


def joints(file: Path, urdf: Path) -> Array:
    """(N, n) joint values, rad or m."""
    return dataset_of(file, gp.load_mechanism(urdf), need_measurement=False).q


def figaroh(table: Path, urdf: Path, poses: Path) -> Array:
    """Six parameters a joint, base and marker, those that the table tells apart, by FIGAROH's own selection and fit."""
    from figaroh.calibration import BaseCalibration
    from figaroh.calibration.calibration_tools import calc_updated_fkm
    from figaroh.tools.load_robot import load_robot

    class Calibration(BaseCalibration):
        def cost_function(self, var: Array) -> Array:
            return self.positions(var, self.q_measured) - self.PEE_measured

        def positions(self, var: Array, q: Array) -> Array:
            """x of all poses, then y, then z, m."""
            return np.asarray(calc_updated_fkm(self.model, self.data, var, q, self.calib_config | {"NbSample": len(q)}))

    with tempfile.TemporaryDirectory() as place:
        robot = load_robot(str(urdf), package_dirs=place)
        names = list(robot.model.names[1:])
        measured = pd.DataFrame(1e-3 * pd.read_csv(table)[POSITION].to_numpy(), columns=["x1", "y1", "z1"])
        observed = pd.DataFrame(joints(table, urdf), columns=names).join(measured)
        observed.to_csv(Path(place) / "observed.csv", index=False)
        task = {
            "kinematics": {"base_frame": "base", "tool_frame": f"link_{len(names)}"},
            "joints": {"active_joints": names},
            "measurements": {"markers": [{"measurable_dof": [True] * 3 + [False] * 3}]},
            "parameters": {"calibration_level": "full_params"},
            "data": {"source_file": f"{place}/observed.csv", "number_of_samples": len(observed)},
        }  # fmt: skip
        (Path(place) / "task.yaml").write_text(json.dumps({"tasks": {"calibration": task}}))
        found = Calibration(robot, f"{place}/task.yaml")
        found.calib_config.update(known_baseframe=False, known_tipframe=False)
        found.initialize()
        amounts = found.solve_optimisation()[0].x
    return found.positions(amounts, joints(poses, urdf)).reshape(3, -1).T


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
