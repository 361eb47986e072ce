"""Bad options: one clear line that names the option, status 2, nothing written."""

from pathlib import Path

import pytest
from cli_cases import one_line, run, table, write

GOOD = table()

OPTIONS: dict[str, tuple[tuple[str, ...], tuple[str, ...]]] = {
    "unknown effect": (("--effect", "gremlins"), ("'gremlins' is unknown", "base_compliance")),
    "effect not on this robot": (("--effect", "gear_harmonic J9"), ("gear_harmonic J9", "has no instance")),
    "effect of too many instances": (("--effect", "transmission_ripple"), ("transmission_ripple", "name one")),
    "effect at an unknown slot": (("--effect", "J9.moving:Rz:1"), ("slot 'J9.moving' is unknown", "J6.moving")),
    "effect about an unknown axis": (("--effect", "J1.moving:Rw:1"), ("axis 'Rw' is unknown", "Tx")),
    "effect of an unknown input": (
        ("--effect", "J1.moving:Rz:sin(temperature)"),
        ("'temperature' is not known", "torque_J6"),
    ),
    "effect that is no expression": (("--effect", "J1.moving:Rz:sin("), ("was never closed",)),
    "effect that runs code": (("--effect", "J1.moving:Rz:__import__('os')"), ("cannot read", "functions are")),
    "effect infinite at a pose": (("--effect", "J1.moving:Rz:1/(row-3)"), ("infinite or undefined",)),
    "effect named twice": (
        ("--effect", "gear_harmonic J4", "--effect", "gear_harmonic J4"),
        ("--effect", "is named twice"),
    ),
    "standard fits nothing": (("--standard", "J9 *"), ("'J9 *'", "J1 Tx")),
    "unknown option": (("--efect", "x"), ("--efect", "calibrate --help")),
    "holdout of everything": (("--holdout", "1"), ("--holdout",)),
    "payload without unit": (("--payload", "60"), ("--payload", "'60' is no quantity")),
    "payload in metres": (("--payload", "60m"), ("--payload", "no unit of mass")),
    "payload centre of two": (("--payload-com", "0,0mm"), ("--payload-com", "three lengths")),
    "unknown frame": (("--frame", "gripper"), ("gripper", "flange")),
}


@pytest.mark.parametrize("case", OPTIONS)
def test_bad_option_is_refused(case: str, tmp_path: Path) -> None:
    options, said = OPTIONS[case]
    path = write(GOOD, tmp_path / "measured.csv")
    line = one_line(run("calibrate", path, "--mechanism", "irb6400r", "--out", tmp_path / "out", *options), 2)
    for words in said:
        assert words in line
    assert sorted(p.name for p in tmp_path.iterdir()) == ["measured.csv"]


NAMED = {
    "--population": ("evolve", "--population", "20"),
    "--operators": ("evolve", "--operators", "magic"),
    "--truncation": ("evolve", "--truncation", "2"),
    "--tournament": ("evolve", "--tournament", "1000000"),
    "--representation": ("evolve", "--representation", "graph"),
    "--holdout": ("calibrate", "--holdout", "0.999"),
    "--noise": ("discover", "--noise", "3"),
    "--instrument": ("check", "--instrument", "Leica"),
    "--mechanism": ("check", "--mechanism", "hal9000"),
}


@pytest.mark.parametrize("option", NAMED)
def test_the_line_opens_with_the_name_of_the_option(option: str, tmp_path: Path) -> None:
    path = write(GOOD, tmp_path / "measured.csv")
    command, *options = NAMED[option]
    mechanism = () if option == "--mechanism" else ("--mechanism", "irb6400r")
    out = () if command == "check" else ("--out", tmp_path / "out")
    assert one_line(run(command, path, *mechanism, *out, *options), 2).startswith(f"gpmodel: {option}: ")


@pytest.mark.parametrize("command", ["check", "discover", "evolve", "fleet"])
def test_an_empty_mechanism_is_unknown(command: str, tmp_path: Path) -> None:
    path = write(GOOD, tmp_path / "measured.csv")
    assert "'' is unknown" in one_line(run(command, path, "--mechanism", ""), 2)


def test_poses_says_nothing_before_it_refuses() -> None:
    assert one_line(run("poses", "--mechanism", "irb6400r", "-n", 3, "--noise", "nan"), 2).startswith(
        "gpmodel: --noise"
    )


@pytest.mark.parametrize("path", ["a\nfit to calibrate with; no warnings\nb", "a\x1b[2Jb", "a\x00b"])
def test_a_path_forges_no_line_of_what_is_printed(path: str, tmp_path: Path) -> None:
    table = write(GOOD, tmp_path / "measured.csv")
    for words in (("check", path), ("check", table, "--out", path), ("certificate", path)):
        arm = ("--mechanism", "irb6400r") if words[0] == "check" else ()
        assert "holds control characters" in one_line(run(*words, *arm), 2)
