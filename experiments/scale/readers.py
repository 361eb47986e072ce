"""List every reader of external files, each with valid texts."""

import json
import random
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from gpmodel.api.table import read_table
from gpmodel.application.model_file import load_model, model_text, saved_model
from gpmodel.calibration.gauss_newton import calibrate
from gpmodel.errors import InputError
from gpmodel.formula.expression import Expression
from gpmodel.mechanism.branches import random_poses
from gpmodel.mechanism.source import MechanismChoice
from gpmodel.model.error_model import ErrorModel, prepare
from gpmodel.model.sites import geometric_effects
from gpmodel.planning.simulate import simulate
from gpmodel.table.cells import frame_of
from gpmodel.texts import SEAL, seal

TOKENS = (
    "", "0", "-1", "1e999", "nan", "inf", "null", "true", "9" * 400, "1" * 5000, "\x00", "\n", "\r\n", "\t", '"', '"""',
    "'", "\\", "/", "../", "*/", "<", "</a>", "<!--", "<!DOCTYPE x [<!ENTITY a 'b'>]>", "&a;", "&#0;", "{", "}", "[",
    "]", "(", ")", "[[", "]]", "(" * 300, "-" * 300, "[" * 3000, "J1", "J1 [deg]", ",", ";", "=", "é", "\u2028",
    "\ufeff", "\U0001f600", "__import__('os')", "lambda: 0", "**", "%", "sin(", "1/0", "log(0)", "{{7*7}}",
    "${x}", "<script>", "NaN", "Infinity", "1_0",
)  # fmt: skip
"""Tokens of the grammars, and tokens that have broken readers before."""


@dataclass(frozen=True)
class Edit:
    """One change of a text: what is done, at what share of its length, to how many characters, with which token."""

    kind: int
    place: float
    length: int
    token: int


def random_edits(rng: random.Random) -> list[Edit]:
    """From one to six edits, mostly few."""
    count = min(6, 1 + int(rng.expovariate(0.8)))
    return [Edit(rng.randrange(5), rng.random(), rng.randrange(40), rng.randrange(len(TOKENS))) for _ in range(count)]


def edited(text: str, edits: list[Edit]) -> str:
    """The text after all edits."""
    for edit in edits:
        at = int(edit.place * (len(text) + 1))
        end = at + edit.length
        match edit.kind:
            case 0:
                text = text[:at] + TOKENS[edit.token] + text[at:]
            case 1:
                text = text[:at] + text[end:]
            case 2:
                text = text[:at] + TOKENS[edit.token] + text[end:]
            case 3:
                text = text[:at] + 3 * text[at:end] + text[end:]
            case _:
                text = (
                    text[:at] + "".join(chr(ord(c) ^ 1 << edit.length % 7) for c in text[at : at + 1]) + text[at + 1 :]
                )
    return text


ARM = MechanismChoice("irb6400r").load()
MASS = '<inertial><mass value="1"/><inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/></inertial>'
URDF = (
    f'<robot name="r"><link name="a"/><link name="b">{MASS}</link><link name="c"/>'
    '<joint name="j" type="revolute"><parent link="a"/><child link="b"/><origin xyz="0 0 1" rpy="0 0.1 0"/>'
    '<axis xyz="0 0 1"/><limit lower="-1" upper="1" effort="0" velocity="0"/></joint>'
    '<joint name="k" type="continuous"><parent link="b"/><child link="c"/><axis xyz="0 1 0"/>'
    '<mimic joint="j" multiplier="2" offset="0"/></joint></robot>'
)
DH = (
    'name = "arm"\nconvention = "modified"\ngravity_m_s2 = [0, 0, -9.81]\n[base]\nxyz_mm = [0, 0, 0]\n[[joint]]\n'
    'name = "J1"\nalpha_deg = 0\na_mm = 100\nd_mm = 800\nlower_deg = -180\nupper_deg = 180\nmass_kg = 2.5\n'
    'com_mm = [1, 2, 3]\n[[joint]]\nkind = "prismatic"\nalpha_rad = 1.5\n[[coupling]]\njoint = "J1"\nfollows = "J2"\n'
    "factor = -1\n"
)
EXPRESSIONS = (
    "sin(2*J4 + 1.9)",
    "J1**3 - 2*J1/J2 % 3",
    "a = J1*J2; max(a, -a) + 1e-3*a",
    "log(abs('oil temp')) - (not J3)",
)


LONGEST = 2000


@dataclass(frozen=True)
class Reader:
    """A reader of a text; texts that it reads; the share of all texts that it is given."""

    read: Callable[[str, Path], object]
    good: tuple[str, ...]
    share: float


def _file(text: str, folder: Path, name: str) -> Path:
    path = folder / name
    path.write_bytes(text.encode("utf-8", "surrogatepass"))
    return path


def _model(text: str, folder: Path) -> object:
    """Load a model with a correct seal after mutation."""
    try:
        content = json.loads(text)
        text = json.dumps(content | {SEAL: seal(content)})
    except (ValueError, TypeError, RecursionError):
        pass
    return load_model(_file(text, folder, "model.json"))


class _Columns:
    """Five poses at which every column is there."""

    def __getitem__(self, name: str) -> np.ndarray:
        return np.linspace(-2.0, 2.0, 5)

    def __len__(self) -> int:
        return 5


def _expression(text: str, folder: Path) -> object:
    return Expression(text)(_Columns())


def readers() -> dict[str, Reader]:
    """By the name of what they read; the shares of all inputs that each gets are as readers are quick."""
    made = simulate(ARM, random_poses(ARM, 20, np.random.default_rng(0)), (), noise=3e-5, rng=np.random.default_rng(0))
    poses = prepare(ARM, made.dataset)
    model = model_text(saved_model(calibrate(ErrorModel(ARM, geometric_effects(ARM)[:6]), poses), poses))
    table = frame_of(made.dataset, ARM).iloc[:4].to_csv(index=False)
    return {
        "expression": Reader(_expression, EXPRESSIONS, 0.7),
        "model": Reader(_model, (model,), 0.07),
        "toml": Reader(lambda t, d: MechanismChoice(str(_file(t, d, "arm.toml"))).load(), (DH,), 0.1),
        "urdf": Reader(lambda t, d: MechanismChoice(str(_file(t, d, "arm.urdf"))).load(), (URDF,), 0.1),
        "table": Reader(lambda t, d: read_table(_file(t, d, "cell.csv"), ARM), (table,), 0.03),
    }


def outcome(reader: Reader, text: str, folder: Path) -> str:
    """`read`, `refused`, or what is wrong with the refusal."""
    try:
        reader.read(text, folder)
    except InputError as error:
        said = str(error)
        return (
            "refused"
            if said and "\n" not in said and len(said) < 3000
            else f"refused in {len(said)} characters: {said[:200]!r}"
        )
    except Exception as error:
        return f"{type(error).__name__}: {error}"
    return "read"
