"""Test imports of files with a known layout, and refusals in one line."""

from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from cli_cases import one_line, robot, run
from instrument_cases import simulated
from scipy.spatial.transform import Rotation

import gpmodel as gp
from gpmodel.arrays import Array
from gpmodel.table.dataset import Dataset

ARM = "irb6400r"


@pytest.fixture(scope="module")
def measured() -> Dataset:
    return robot(30, 2)[1].dataset


def figaroh(dataset: Dataset, path: Path, **columns: Array) -> Path:
    joints = pd.DataFrame(dataset.q, columns=[f"J{i + 1}" for i in range(6)])
    points = pd.DataFrame(dataset.position, columns=["x1", "y1", "z1"])
    pd.concat([points, pd.DataFrame(columns), joints], axis=1).to_csv(path, index=False)
    return path


def test_a_table_of_figaroh_passes_check(measured: Dataset, tmp_path: Path) -> None:
    turned = np.random.default_rng(1).uniform(-1, 1, (30, 3))
    angles = {f"phi{a}1": v for a, v in zip("xyz", turned.T, strict=True)}
    source, out = figaroh(measured, tmp_path / "f.csv", **angles), tmp_path / "t.csv"
    assert run("import", source, "--mechanism", ARM, "--out", out).exit_code == 0
    table = gp.read_table(out, ARM)
    np.testing.assert_allclose(table.q, measured.q)
    np.testing.assert_allclose(table.position, measured.position)
    np.testing.assert_allclose(table.rotation, Rotation.from_euler("xyz", turned).as_rotvec())
    plain = figaroh(measured, tmp_path / "plain.csv")
    said = one_line(run("import", plain, "--mechanism", ARM, "--out", out), 2)
    assert "exists with other content; expected another name" in said
    out = tmp_path / "plain_table.csv"
    assert run("import", plain, "--mechanism", ARM, "--out", out).exit_code == 0
    done = run("check", out, "--mechanism", ARM)
    assert done.exit_code == 0
    assert "no warnings" in done.stdout


def test_markers_of_one_pose_are_tools_that_stay_together(measured: Dataset, tmp_path: Path) -> None:
    second = {f"{a}2": v + 0.1 for a, v in zip("xyz", measured.position.T, strict=True)}
    source, out = figaroh(measured, tmp_path / "f.csv", **second), tmp_path / "t.csv"
    assert run("import", source, "--mechanism", ARM, "--out", out).exit_code == 0
    table = gp.read_table(out, ARM)
    assert table.label("tool").tolist() == ["1", "2"] * 30
    assert table.label("group").tolist() == [str(k // 2 + 1) for k in range(60)]
    np.testing.assert_allclose(table.position[1::2], measured.position + 0.1)


CAMERA = """image_width: 1280
camera_name: left eye
camera_matrix: {tag}
  rows: 3
  cols: 3
  data: [{fx}, 0., {cx}, 0., {fy}, {cy}, 0., 0., 1.]
distortion_model: plumb_bob
distortion_coefficients: {tag}
  rows: 1
  cols: 5
  data: [-0.1, 0.01, 0.001, -0.002, 0.0]
"""


def test_a_camera_of_ros_or_opencv_is_a_cameras_file(tmp_path: Path) -> None:
    pytest.importorskip("yaml")
    numbers = {"fx": 1000.5, "fy": 1001.0, "cx": 640.0, "cy": 360.25}
    for tag, head in (("", ""), ("!!opencv-matrix", "%YAML:1.0\n---\n")):
        source, out = tmp_path / "camera.yaml", tmp_path / "cameras.toml"
        source.write_text(head + CAMERA.format(tag=tag, **numbers))
        assert run("import", source, "--out", out).exit_code == 0
        text = out.read_text()
        assert "[camera.left_eye]" in text
        assert "focal_px = [1000.5, 1001.0]" in text
        assert "centre_px = [640.0, 360.25]" in text
        assert "distortion = [-0.1, 0.01, 0.001, -0.002, 0.0]" in text
    source.write_text(CAMERA.format(tag="", **numbers).replace("plumb_bob", "equidistant"))
    assert "equidistant; expected plumb_bob" in one_line(run("import", source), 2)
    source.write_text("a: 1")
    assert "no camera_matrix and no image_points" in one_line(run("import", source), 2)


@pytest.mark.long
def test_corners_of_opencv_calibrate_as_simulated_ones(tmp_path: Path) -> None:
    pytest.importorskip("yaml")
    made = simulated("camera", 20)
    table, board = made.table, made.table.described["board"]["board"]["B"]
    camera = made.table.described["cameras"]["camera"]["C"]
    count = int(board["columns"] * board["rows"])
    k = [
        camera["focal_px"][0],
        0.0,
        camera["centre_px"][0],
        0.0,
        camera["focal_px"][1],
        camera["centre_px"][1],
        0,
        0,
        1,
    ]
    uv = np.column_stack([table.readings["u"], table.readings["v"]]).ravel().tolist()
    lines = ["%YAML:1.0", "---", f"board_width: {board['columns']}", f"board_height: {board['rows']}",
             f"camera_matrix: !!opencv-matrix\n   rows: 3\n   cols: 3\n   dt: d\n   data: {k}",
             f"image_points: !!opencv-matrix\n   rows: 20\n   cols: {count}\n   dt: \"2f\"\n   data: {uv}"]  # fmt: skip
    if "distortion" in camera:
        lines.append(f"distortion_coefficients: !!opencv-matrix\n   data: {camera['distortion']}")
    source, poses, out = tmp_path / "corners.yml", tmp_path / "poses.csv", tmp_path / "t.csv"
    source.write_text("\n".join(lines))
    q = np.degrees(table.q[::count])
    pd.DataFrame(q, columns=[f"J{i + 1} [deg]" for i in range(6)]).to_csv(poses, index=False)
    size = f"{board['pitch_mm']}mm"
    assert "--joints" in one_line(run("import", source, "--out", out), 2)
    done = run("import", source, "--joints", poses, "--square", size, "--out", out)
    assert done.exit_code == 0, done.stderr
    options = done.stdout.partition("read with")[2].split()
    done = run("check", out, "--mechanism", ARM, *options)
    assert done.exit_code == 0, done.stderr
    again = gp.read_table(out, ARM, cameras=tmp_path / "t.cameras.toml", board=tmp_path / "t.board.toml")
    np.testing.assert_allclose(again.readings["u"], table.readings["u"])
    pd.DataFrame(q[:9], columns=[f"J{i + 1} [deg]" for i in range(6)]).to_csv(poses, index=False)
    said = one_line(run("import", source, "--joints", poses, "--square", size, "--out", out), 2)
    assert "9 rows, 20 views" in said


NOMINAL = """[DH]
a = [0.00000, -0.425, -0.3922, 0.0, 0.0, 0.0]
d = [0.1625, 0.0, 0.0, 0.1333, 0.0997, 0.0996]
alpha = [ 1.570796327, 0, 0, 1.570796327, -1.570796327, 0 ]
q_home_offset = [0, -1.570796327, 0, -1.570796327, 0, 0]
"""
DELTA = """[mounting]
delta_theta = [ -8.2e-05, -0.1036, 0.6736, -0.5702, -4.6e-05, 9.7e-07]
delta_a = [ -0.00016, 0.0030, 0.0916, -9.6e-05, -3.0e-05, 0]
delta_d = [ 0.0005, 11.198, -92.527, 81.328, -0.0002, -0.0001]
delta_alpha = [ -0.0003, -0.0057, -0.0038, -0.0011, 0.0010, 0]
joint_checksum = [ 0x6e0f7bf, 0xa32a713f, 0xf636a50, 0x9ec2338a, 0xa1afded8, 0xb29b2979]
calibration_status = 2 # 0 == notInitialized / 1 == notLinearised / 2 == Linearised
"""


def test_calibration_conf_is_the_arm_that_the_controller_computes_with(tmp_path: Path) -> None:
    source, nominal, out = tmp_path / "calibration.conf", tmp_path / "urcontrol.conf", tmp_path / "arm.toml"
    source.write_text(DELTA)
    nominal.write_text(NOMINAL)
    assert "--nominal urcontrol.conf" in one_line(run("import", source), 2)
    assert run("import", source, "--nominal", nominal, "--out", out).exit_code == 0
    arm = gp.load_mechanism(str(out))
    assert [joint.name for joint in arm.joints][:2] == ["shoulder_pan_joint", "shoulder_lift_joint"]
    rows = {name: eval(text) for name, _, text in (line.partition(" = ") for line in (NOMINAL + DELTA).splitlines()[1:])
            if name in ("a", "d", "alpha") or name.startswith("delta")}  # fmt: skip
    q, frame = np.array([0.3, -1.0, 0.8, -0.4, 0.6, 0.2]), np.eye(4)
    for i in range(6):
        step = np.eye(4)
        turn = Rotation.from_euler("z", q[i] + rows["delta_theta"][i])
        step[:3, :3] = (turn * Rotation.from_euler("x", rows["alpha"][i] + rows["delta_alpha"][i])).as_matrix()
        step[:3, 3] = turn.apply([rows["a"][i] + rows["delta_a"][i], 0, rows["d"][i] + rows["delta_d"][i]])
        frame = frame @ step
    product = np.eye(4)
    for transform in arm.transforms(q[None])[:, 0]:
        product = product @ transform
    np.testing.assert_allclose(product, frame, atol=1e-9)
    source.write_text(DELTA.replace("0.0010, 0]", "0.0010]"))
    assert "delta_alpha is [" in one_line(run("import", source, "--nominal", nominal), 2)
    source.write_text(DELTA.replace("delta_d", "delta_dd"))
    assert "no line 'delta_d = [...]'" in one_line(run("import", source, "--nominal", nominal), 2)


def write_bag(path: Path, dataset: Dataset, late: float = 0.0, topics: int = 1) -> None:
    from rosbags.rosbag1 import Writer
    from rosbags.typesys import Stores, get_typestore

    store = get_typestore(Stores.ROS1_NOETIC)
    types = store.types
    with Writer(path) as bag:
        state, point = "sensor_msgs/msg/JointState", "geometry_msgs/msg/PointStamped"
        joints = bag.add_connection("/joint_states", state, typestore=store)
        seen = [bag.add_connection(f"/tracker{k}", point, typestore=store) for k in range(topics)]
        for k, (q, p) in enumerate(zip(dataset.q, dataset.position, strict=True)):
            for connection, kind, seconds in [(joints, state, k), *((s, point, k + late) for s in seen)]:
                stamp = types["builtin_interfaces/msg/Time"](int(seconds), int(1e9 * (seconds % 1)))
                header = types["std_msgs/msg/Header"](0, stamp, "base")
                if kind == state:
                    names = [f"J{i}" for i in (6, 5, 4, 3, 2, 1)]
                    message = types[state](header, names, q[::-1].copy(), np.zeros(0), np.zeros(0))
                else:
                    message = types[point](header, types["geometry_msgs/msg/Point"](*p))
                bag.write(connection, int(1e9 * seconds), store.serialize_ros1(message, kind))


def test_a_bag_of_ros_passes_check(measured: Dataset, tmp_path: Path) -> None:
    pytest.importorskip("rosbags")
    out = tmp_path / "t.csv"
    write_bag(tmp_path / "run.bag", measured, 0.01)
    done = run("import", tmp_path / "run.bag", "--mechanism", ARM, "--out", out)
    assert done.exit_code == 0, done.stderr
    table = gp.read_table(out, ARM)
    np.testing.assert_allclose(table.q, measured.q)
    np.testing.assert_allclose(table.position, measured.position)
    assert run("check", out, "--mechanism", ARM).exit_code == 0
    assert "expected --mechanism M" in one_line(run("import", tmp_path / "run.bag"), 2)
    write_bag(tmp_path / "late.bag", measured, 0.3)
    said = one_line(run("import", tmp_path / "late.bag", "--mechanism", ARM), 2)
    assert "0.30 s from any joint state" in said
    write_bag(tmp_path / "two.bag", measured, topics=2)
    assert "/tracker0, /tracker1; expected one" in one_line(run("import", tmp_path / "two.bag", "--mechanism", ARM), 2)
    assert run("import", tmp_path / "two.bag", "--mechanism", ARM, "--topic", "/tracker1").exit_code == 0


def test_what_is_missing_for_a_bag_is_one_line(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(__import__("sys").modules, "rosbags.highlevel", None)
    monkeypatch.setitem(__import__("sys").modules, "rosbags", None)
    (tmp_path / "run.bag").write_bytes(b"#ROSBAG V2.0\n")
    said = one_line(run("import", tmp_path / "run.bag", "--mechanism", ARM), 2)
    assert "reading run.bag needs rosbags: pip install 'gpmodel[ros]'" in said


def test_what_has_no_known_layout_asks_for_a_map(measured: Dataset, tmp_path: Path) -> None:
    source = figaroh(measured, tmp_path / "f.csv")
    assert "expected --mechanism M" in one_line(run("import", source), 2)
    more = figaroh(measured, tmp_path / "more.csv", gripper=measured.q[:, 0])
    assert "left out, not in the joints of" in run("import", more, "--mechanism", ARM).stderr
    source.write_text(source.read_text().replace("J3", "Jx", 1))
    assert "no values of joint 'J3'" in one_line(run("import", source, "--mechanism", ARM), 2)
    source.write_text(source.read_text().replace("x1", "px", 1))
    assert "expected --map MAP.toml" in one_line(run("import", source), 2)
