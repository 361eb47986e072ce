"""Tables 3.2, 3.4 and 3.5; rigs are simulated, 31 poses with the published centre, radius, noise and eccentricities."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from experiments.spherical_joint.reductions import most_common_reduction, observable_in_words, reduce_in_order
from experiments.spherical_joint.rig import Rig
from experiments.spherical_joint.sphere_fit import fit_sphere
from gpmodel.calibration.gauss_newton import calibrate
from gpmodel.model.error_model import ErrorModel, prepare
from gpmodel.planning.poses import spread_poses
from joints import spherical_joint
from joints.budget import thesis_columns
from joints.passive_joint import THESIS_PARAMETERS, parameter

JOINT = spherical_joint()
OFFSETS = {14: -2.54e-6, 15: -25.4e-6, 19: 20.32e-6}
RIG = Rig(JOINT, parameters=OFFSETS)
MODELS = {
    "Base and TCP": (),
    "Position offset": tuple(OFFSETS),
    "All parameters": tuple(p.index for p in THESIS_PARAMETERS),
}
PITCH_OFFSET = tuple(OFFSETS).index(15)


def model(name: str) -> ErrorModel:
    return ErrorModel(JOINT, tuple(parameter(i).effect for i in MODELS[name]))


def summary(error: NDArray[np.float64]) -> dict[str, float]:
    """Mean, mean plus three standard deviations and maximum, µm."""
    micrometres = 1e6 * error
    return {
        "mean_um": float(micrometres.mean()),
        "mean_plus_3sd_um": float(micrometres.mean() + 3 * micrometres.std()),
        "max_um": float(micrometres.max()),
    }


def tables(rigs: int) -> dict[str, Any]:
    """Means over fresh rigs; the sphere against base and TCP; the offset of the pitch axis against the truth."""
    rows: dict[str, list[dict[str, float]]] = {name: [] for name in ("Sphere fit", *MODELS)}
    differences, offsets, kept = [], [], set()
    for seed in range(rigs):
        rng = np.random.default_rng(seed)
        data = RIG.measure(RIG.poses(31, rng), rng)
        sphere, fits = fit_sphere(data.position), {}
        rows["Sphere fit"].append(summary(np.abs(sphere.residual)))
        for name in MODELS:
            fits[name] = calibrate(model(name), prepare(JOINT, data), robust=False)
            rows[name].append(summary(fits[name].error))
        base = fits["Base and TCP"].placement
        radius = np.linalg.norm(base.tool[""][:3, 3] + JOINT.tooling_ball)
        differences += [*np.abs(base.registration[""][:3, 3] - sphere.centre), abs(radius - sphere.radius)]
        offset = fits["Position offset"]
        offsets.append([offset.theta[PITCH_OFFSET], offset.stderr[PITCH_OFFSET]])
        everything = fits["All parameters"]
        kept.add(tuple(p.index for p, k in zip(THESIS_PARAMETERS, everything.kept, strict=True) if k))
    found = 1e6 * np.array(offsets)
    return {
        "rigs": rigs,
        "table_3_4_largest_difference_um": 1e6 * float(max(differences)),
        "table_3_5": {
            name: {key: float(np.mean([row[key] for row in values])) for key in values[0]}
            for name, values in rows.items()
        },
        "kept_of_all_parameters": sorted(kept),
        "pitch_offset": {
            "true_um": 1e6 * OFFSETS[15],
            "mean_um": float(found[:, 0].mean()),
            "scatter_um": float(found[:, 0].std()),
            "stated_sigma_um": float(found[:, 1].mean()),
            "within_3_sigma": int((np.abs(found[:, 0] - 1e6 * OFFSETS[15]) < 3 * found[:, 1]).sum()),
        },
    }


def reduction() -> dict[str, Any]:
    rng = np.random.default_rng(0)
    q = spread_poses(JOINT, 100, rng)
    ordered, (common, counts) = reduce_in_order(thesis_columns(JOINT, q)), most_common_reduction(JOINT, rng)
    answers = {", ".join(map(str, kept)): count for kept, count in counts.most_common()}
    return {
        "in_order": {"kept": ordered.kept, "condition": ordered.condition},
        "by_svd_20_trials": {"most_common": common.kept, "condition": common.condition, "answers": answers},
        "free_angles": observable_in_words(JOINT, q),
    }
