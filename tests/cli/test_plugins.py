"""Commands and mechanisms of other packages, by their entry points."""

from importlib.metadata import EntryPoint

import click
import pytest
from cli_cases import run

from gpmodel.cli import main as cli
from gpmodel.errors import InputError
from gpmodel.mechanism import source as plugins


def test_command_of_another_package_is_found(monkeypatch: pytest.MonkeyPatch) -> None:
    plugin = EntryPoint("extra", "cli_plugin:extra", cli.PLUGINS)

    @click.command()
    def extra() -> None:
        click.echo("from outside")

    monkeypatch.setattr(EntryPoint, "load", lambda self: extra)
    monkeypatch.setattr(cli, "entry_points", lambda group, name="extra": [plugin] if name == "extra" else [])
    assert "\n  extra" in run("--help").stdout
    assert run("extra").stdout == "from outside\n"


def test_mechanisms_are_asked_of_every_provider(monkeypatch: pytest.MonkeyPatch) -> None:
    asked: list[tuple[str, str | None, object]] = []

    def nobody(name: str, *, frame: str | None = None, payload_com: object = None) -> None:
        asked.append((name, frame, payload_com))

    providers = [EntryPoint(n, "gpmodel.errors:load_mechanism", plugins.PROVIDERS) for n in ("one", "two")]
    monkeypatch.setattr(plugins, "entry_points", lambda group: providers)
    monkeypatch.setattr(EntryPoint, "load", lambda self: nobody)
    with pytest.raises(InputError, match="'ghost' is unknown"):
        plugins.load_mechanism("ghost", frame="tip", payload_com=(0, 0, 1))
    assert asked == [("ghost", "tip", (0, 0, 1))] * 2


def test_an_unknown_mechanism_is_answered_with_those_of_every_provider_that_are_like_it() -> None:
    with pytest.raises(InputError, match=r"one of irb6400r, .* others"):
        plugins.load_mechanism("irb6400")
    with pytest.raises(InputError, match=r"one of hexapod, .* others"):
        plugins.load_mechanism("hexapode")


def test_broken_provider_is_named_only_when_nobody_knows(monkeypatch: pytest.MonkeyPatch) -> None:
    real = plugins.entry_points(group=plugins.PROVIDERS)
    broken = EntryPoint("broken", "no_such_module:load", plugins.PROVIDERS)
    monkeypatch.setattr(plugins, "entry_points", lambda group: [broken, *real])
    assert plugins.load_mechanism("irb6400r").name == "irb6400r"
    with pytest.raises(InputError, match="provider 'broken' cannot be loaded"):
        plugins.load_mechanism("ghost")
