"""Sequences scored on a CUDA device: the numbers of the processor, and one line where there is no device."""

import os
import subprocess
import sys
from pathlib import Path

import device_cases
import numpy as np
import pytest
from device_cases import CASES

from gpmodel.api.evolve_settings import Effort, settings_for
from gpmodel.errors import InputError
from gpmodel.evolution import device
from gpmodel.evolution.generations import Generations
from gpmodel.evolution.kernels import cuda
from gpmodel.evolution.linear import Linear
from gpmodel.evolution.problems import CartesianProblem, Inputs, SlotProblem
from gpmodel.evolution.projection import regression
from gpmodel.evolution.settings import Budget, Settings
from gpmodel.evolution.tree import Tree


def why_not() -> str:
    """What is missing for a device, empty where there is one."""
    try:
        device.check_device()
    except InputError as error:
        return str(error)
    return ""


@pytest.fixture(scope="module")
def simulated(tmp_path_factory: pytest.TempPathFactory) -> dict[str, np.ndarray]:
    path = tmp_path_factory.mktemp("device") / "scores.npz"
    paths = [str(Path(__file__).parents[2]), os.environ.get("PYTHONPATH", "")]
    environment = os.environ | {
        "NUMBA_ENABLE_CUDASIM": "1", "NUMBA_DISABLE_JIT": "1", "PYTHONPATH": os.pathsep.join(paths),
    }  # fmt: skip
    subprocess.run([sys.executable, "-W", "ignore", device_cases.__file__, str(path)], check=True, env=environment)
    with np.load(path) as found:
        return dict(found)


@pytest.mark.parametrize("name", CASES)
def test_the_kernels_of_a_device_give_the_processors_numbers(name: str, simulated: dict[str, np.ndarray]) -> None:
    expected = CASES[name].scores("cpu", 20)
    np.testing.assert_array_equal(simulated[f"{name} hashes"], expected.hashes)
    np.testing.assert_array_equal(simulated[f"{name} complexity"], expected.complexity)
    np.testing.assert_allclose(simulated[f"{name} score"], expected.score, rtol=1e-12)
    assert np.isfinite(expected.score).sum() > 10
    assert len(set(expected.score.tolist())) > 8


@pytest.mark.skipif(bool(why_not()), reason=why_not())
@pytest.mark.parametrize("name", CASES)
def test_a_device_gives_the_processors_numbers(name: str) -> None:
    expected, found = (CASES[name].scores(where, 5000) for where in ("cpu", "cuda"))
    np.testing.assert_array_equal(found.hashes, expected.hashes)
    np.testing.assert_array_equal(found.complexity, expected.complexity)
    alike = np.isclose(found.score, expected.score, rtol=1e-9) | (np.isinf(found.score) & np.isinf(expected.score))
    assert alike.mean() > 0.99, "programs that blow a rounding up are few"


@pytest.mark.parametrize(("installed", "said"), [(False, "pip install 'gpmodel[cuda]'"), (True, "no CUDA device")])
def test_without_a_device_one_line_says_what_is_missing(
    installed: bool, said: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(cuda.cuda, "is_available", lambda: False)
    monkeypatch.setattr(device, "find_spec", lambda name: object() if installed else None)
    with pytest.raises(InputError, match=said.replace("[", r"\[").replace("]", r"\]")) as caught:
        CASES["thesis"].scores("cuda", 20)
    assert caught.value.argument == "device"
    assert "\n" not in str(caught.value)


def test_what_a_device_is_not_for_is_refused() -> None:
    x = np.random.default_rng(0).normal(size=(3, 9))
    inputs = Inputs(("x", "y", "z"), x)
    asked = Settings(Linear(), budget=Budget(64, 1, device="cuda"))
    with pytest.raises(InputError, match="Cartesian space only"):
        Generations(SlotProblem(inputs, regression(x[0] * x[1])), asked, np.random.default_rng(0))
    with pytest.raises(InputError, match="linear sequences in Cartesian space"):
        settings_for("slot", (Linear(), Tree()), Effort(device="cuda"))
    with pytest.raises(InputError, match="linear sequences in Cartesian space"):
        settings_for("cartesian", (Tree.thesis(),), Effort(device="cuda"))
    with pytest.raises(InputError, match="'gpu', expected cpu or cuda"):
        Budget(device="gpu")  # type: ignore[arg-type]
    chosen = settings_for("cartesian", (Linear.thesis(), Tree.thesis()), Effort(device="cuda"))
    assert {name: s.budget.device for name, s in chosen.items()} == {"linear": "cuda", "tree": "cpu"}


def test_trees_are_not_run_on_a_device(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(cuda.cuda, "is_available", lambda: True)
    x = np.random.default_rng(0).normal(size=(3, 9))
    problem = CartesianProblem(Inputs(("x", "y", "z"), x), x)
    asked = Settings(Tree.thesis(), budget=Budget(64, 1, device="cuda"))
    with pytest.raises(InputError, match="linear sequences only"):
        Generations(problem, asked, np.random.default_rng(0)).start()
