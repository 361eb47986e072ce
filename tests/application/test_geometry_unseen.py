"""The exported geometry states its error at poses it has not seen, also where none were held out for good."""

from model_cases import fitted

from gpmodel.application.exports.rigid import note_of, refitted
from gpmodel.calibration.gauss_newton import calibrate
from gpmodel.model.error_model import prepare
from gpmodel.numerics.least_squares import root_mean_square


def test_each_pose_is_left_out_of_a_fit_of_the_geometry_once() -> None:
    saved, dataset = fitted("geometry")
    rigid = refitted(saved)
    fitted_to = root_mean_square(calibrate(saved.model, prepare(saved.mechanism, dataset)).error)
    assert len(rigid.heldout) == len(dataset)
    assert fitted_to < root_mean_square(rigid.heldout) < 3.0 * fitted_to
    assert "Error on held-out poses" in note_of(rigid, "calibrated.urdf")
