"""Output of the command line."""

from gpmodel.cli.console import session_note


def test_what_belongs_to_a_session_is_said_once_and_not_wave_by_wave() -> None:
    waves = tuple(f"walk of the instrument, shift T{axis}, wave {k}" for axis in "xyz" for k in range(1, 9))
    note = session_note((*waves, "drift of the set-up Rz"), session=True)
    assert note.endswith(": walk of the instrument, shift, drift of the set-up Rz")
