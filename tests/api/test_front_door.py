"""Test the names of `import gpmodel as gp`, the modules that they load, and their return values."""

import subprocess
import sys
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from cli_cases import run, table, write
from robots_cases import ODD_URDF

import gpmodel as gp

FRAME = table(60, effects=("base_compliance=3e-7",))


def test_importing_it_loads_neither_click_nor_matplotlib_nor_rich_nor_numbers() -> None:
    code = "import sys, gpmodel; print(sorted({'click', 'matplotlib', 'rich', 'numpy', 'pandas'} & set(sys.modules)))"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "[]"


@pytest.mark.long
def test_every_public_name_is_there_and_none_of_them_loads_the_command_line() -> None:
    code = (
        "import sys, gpmodel as gp\n"
        "found = [getattr(gp, name) for name in gp.__all__]\n"
        "assert set(gp.__all__) <= set(dir(gp))\n"
        "print(len(found), sorted({'click', 'matplotlib', 'rich'} & set(sys.modules)))"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == f"{len(gp.__all__)} []"
    with pytest.raises(AttributeError, match="no attribute 'nonsense'"):
        _ = gp.nonsense


LEAN = """
import sys
from gpmodel.extras import EXTRAS
BLOCKED = {module for modules in EXTRAS.values() for module in modules}
class Lean:
    def find_spec(self, name, path=None, target=None):
        if name.partition(".")[0] in BLOCKED:
            raise ModuleNotFoundError(f"No module named {name!r}", name=name)
sys.meta_path.insert(0, Lean())
import gpmodel as gp
def said(call):
    try:
        call()
    except gp.InputError as error:
        return str(error)
"""
"""Python source that makes modules of the extras unimportable."""


def lean(code: str) -> str:
    done = subprocess.run([sys.executable, "-c", LEAN + code], capture_output=True, text=True, check=True)
    return done.stdout.strip()


@pytest.mark.long
def test_a_lean_installation_has_all_names_but_the_search_and_says_which_extra_brings_that() -> None:
    out = lean("for name in gp.__all__:\n    wrong = said(lambda: getattr(gp, name))\n    if wrong: print(wrong)")
    assert out.splitlines() == [
        f"gpmodel.{name} needs sympy: pip install 'gpmodel[discover]'" for name in ("discover", "fleet")
    ]


@pytest.mark.long
def test_a_lean_installation_calibrates_saves_predicts_and_compensates(tmp_path: Path) -> None:
    path, model = write(FRAME, tmp_path / "t.csv"), tmp_path / "model.json"
    out = lean(
        f"fit = gp.calibrate(gp.load_mechanism('irb6400r'), {str(path)!r}, ['base_compliance'])\n"
        f"fit.model.save({str(model)!r})\n"
        f"model = gp.load_model({str(model)!r})\n"
        f"print(len(model.predict({str(path)!r})), model.compensate({str(path)!r})['residual [mm]'].max() < 1e-5)\n"
        f"print(said(lambda: fit.report({str(tmp_path / 'r')!r})), said(model.export), sep='\\n')\n"
        f"print(said(lambda: gp.evolve('irb6400r', {str(path)!r})), said(lambda: gp.load_mechanism('ur5')), sep='\\n')"
    ).splitlines()
    assert out[0] == "60 True"
    assert [line.partition("needs")[2].partition(": ")[2] for line in out[1:]] == [
        f"pip install 'gpmodel[{extra}]'" for extra in ("report", "report", "discover", "robots")
    ]
    assert not (tmp_path / "r").exists()


@pytest.mark.long
def test_a_lean_installation_says_which_extra_draws_pages(tmp_path: Path) -> None:
    """A result from another computer needs no extra until a page is drawn."""
    path, folder, command = write(FRAME, tmp_path / "t.csv"), str(tmp_path / "r"), "from gpmodel.cli.main import main\n"
    gp.calibrate(gp.load_mechanism("irb6400r"), str(path), ["base_compliance"]).report(folder)
    asked = [
        f"gp.certificate({folder!r}).report('c')",
        f"gp.compare({folder!r}, {folder!r}).report('c')",
        f"gp.explain({folder!r}, 1)",
    ]
    out = lean("\n".join(f"print(said(lambda: {each}))" for each in asked)).splitlines()
    assert [line.partition("pip install ")[2] for line in out] == ["'gpmodel[report]'"] * 3
    for name, *more in (("report",), ("certificate",), ("compare", folder, "--out", "c"), ("explain", "1")):
        code = f"{command}main({[name, folder, *more]!r})"
        done = subprocess.run([sys.executable, "-c", LEAN + code], capture_output=True, text=True)
        assert (done.returncode, done.stderr.count("\n")) == (2, 1), done.stderr
        assert "pip install 'gpmodel[" in done.stderr


@pytest.mark.long
def test_a_robot_read_from_urdf_predicts_without_pinocchio(tmp_path: Path) -> None:
    arm, path = tmp_path / "arm.urdf", tmp_path / "t.csv"
    arm.write_text(ODD_URDF)
    gp.simulate(str(arm), ["joint_compliance lift=1e-6"], poses=60, seed=1).save(path)
    fit = gp.calibrate(str(arm), path, ["joint_compliance lift"])
    fit.model.save(tmp_path / "model.json")
    fit.model.predict(path).to_csv(tmp_path / "here.csv", index=False)
    out = lean(
        f"import numpy as np, pandas as pd\n"
        f"there = gp.load_model({str(tmp_path / 'model.json')!r}).predict({str(path)!r})\n"
        f"here = pd.read_csv({str(tmp_path / 'here.csv')!r})\n"
        "names = ['predicted_x [mm]', 'predicted_y [mm]', 'predicted_z [mm]']\n"
        "print(np.abs(there[names].astype(float) - here[names]).to_numpy().max() < 1e-9, 'pinocchio' in sys.modules)"
    )
    assert out == "True False"


def test_the_public_names_are_those_a_user_writes() -> None:
    """The names are those in the README, the tour, and outside mechanisms, families and effects."""
    ten_lines = {"load_mechanism", "read_table", "calibrate", "discover", "load_model", "evolve", "simulate", "check"}
    choices = {"choose_poses", "catalogue", "Search", "Criteria", "Linear", "Tree", "InputError", "Model", "Dataset"}
    choices |= {"Truncation", "Tournament"}
    own = {"fleet", "Effect", "Term", "Expression", "effect_at", "Candidate", "Family", "Mechanism", "Joint", "States"}
    results = {"regress", "verify", "verify_next", "certificate", "compare", "explain", "export", "load_result"}
    assert set(gp.__all__) == ten_lines | choices | own | results
    assert gp.__version__


def test_a_frame_and_a_file_are_the_same_table(tmp_path: Path) -> None:
    arm = gp.load_mechanism("irb6400r")
    path = write(FRAME.assign(group="a", note=""), tmp_path / "t.csv")
    file, frame = gp.read_table(path, arm), gp.read_table(pd.read_csv(path), arm)
    np.testing.assert_array_equal(file.q, frame.q)
    np.testing.assert_array_equal(file.position, frame.position)
    assert file.label("group").tolist() == frame.label("group").tolist()
    assert len(frame.sha256) == 64


@pytest.mark.long
def test_a_payload_belongs_to_the_mechanism_wherever_the_table_came_from(tmp_path: Path) -> None:
    path = write(FRAME, tmp_path / "t.csv")
    plain, loaded = gp.load_mechanism("irb6400r"), gp.load_mechanism("irb6400r", payload="60 kg")
    assert "60 kg" in repr(loaded)
    assert set(gp.read_table(path, loaded).payload) == {60.0}
    fits = [gp.calibrate(loaded, source, ["base_compliance"]) for source in (path, gp.read_table(path, plain))]
    values = [fit.model.saved.theta for fit in fits]
    np.testing.assert_array_equal(*values)
    point = fits[0].model.saved.placement.tool[""][:3, 3]
    assert fits[0].model.mechanism.choice.payload_com == pytest.approx(point, abs=1e-3)  # type: ignore[attr-defined]


@pytest.mark.long
def test_calibrate_says_what_the_command_says(tmp_path: Path) -> None:
    path = write(FRAME, tmp_path / "t.csv")
    fit = gp.calibrate(gp.load_mechanism("irb6400r"), path, ["base_compliance"])
    command = run("calibrate", path, "--mechanism", "irb6400r", "--effect", "base_compliance")
    assert command.stdout == fit.summary() + "\n"
    rows = fit.to_dataframe()
    (found,) = rows[rows["name"] == "base compliance"].to_dict("records")
    assert found["value"] == pytest.approx(3e-7, abs=4 * found["stderr"])
    assert fit.ladder()["step"].tolist() == [
        "registration only", "standard model", "base_compliance",
    ]  # fmt: skip

    assert "<table" in fit._repr_html_()
    assert len(repr(fit).splitlines()) == 1


@pytest.mark.long
def test_an_effect_object_is_calibrated_like_a_named_one() -> None:
    arm = gp.load_mechanism("irb6400r")
    mine = gp.effect_at("mine", "J4.moving", "Rz", gp.Expression("sin(2*J4)"))
    fit = gp.calibrate(arm, FRAME, [mine])
    assert "mine" in fit.to_dataframe()["name"].tolist()


@pytest.mark.long
def test_a_saved_model_predicts_and_compensates_frames(tmp_path: Path) -> None:
    arm = gp.load_mechanism("irb6400r")
    fit = gp.calibrate(arm, FRAME, ["base_compliance"])
    fit.model.save(tmp_path / "model.json")
    model = gp.load_model(tmp_path / "model.json")
    joints = FRAME[[f"J{i} [deg]" for i in range(1, 7)]].astype(float)
    predicted = model.predict(joints)
    assert predicted.columns.tolist()[-5:] == ["x [mm]", "y [mm]", "z [mm]", "sigma [mm]", "outside"]
    miss = predicted[["x [mm]", "y [mm]", "z [mm]"]].to_numpy() - FRAME[["x [mm]", "y [mm]", "z [mm]"]].astype(float)
    assert np.linalg.norm(miss, axis=1).mean() < 0.1
    assert model.misses(FRAME).mean() < 0.1
    corrected = model.compensate(joints.iloc[:3])
    assert {"corrected_J1 [deg]", "correction [mm]", "status"} <= set(corrected.columns)
    assert fit.model.summary() == model.summary()


@pytest.mark.long
def test_simulated_tables_go_through_the_front_door(tmp_path: Path) -> None:
    arm = gp.load_mechanism("irb6400r", payload="60 kg")
    made = gp.simulate(arm, ["joint_compliance J2=1e-6"], poses=60, seed=3, inputs={"temperature [degC]": "20:30"})
    assert made.truth.misses(made.table).max() < 0.2
    assert gp.check(arm, made.table).valid
    truth = made.save(tmp_path / "t.csv")
    assert gp.load_model(truth).summary() == made.truth.summary()
    assert gp.calibrate(arm, made.table, ["joint_compliance J2"]).ladder()["held-out rms [mm]"].iloc[-1] < 0.1


def test_chosen_poses_are_a_table_of_joint_values() -> None:
    arm = gp.load_mechanism("irb6400r")
    poses = gp.choose_poses(arm, 12)
    assert poses.to_dataframe().columns.tolist() == [f"J{i} [deg]" for i in range(1, 7)]
    assert len(gp.simulate(arm, poses=poses.to_dataframe()).table) == 12


def test_the_centre_of_a_payload_is_within_a_kilometre_of_the_flange() -> None:
    for far in ("0,0,2km", (0.0, 0.0, float("nan")), (-2000.0, 0.0, 0.0)):
        with pytest.raises(gp.InputError, match=r"payload_com: .*, expected three lengths of at most 1000 m"):
            gp.load_mechanism("irb6400r", payload_com=far)
