"""Names of the library, and of packages that register their own by an entry point."""

from importlib.metadata import EntryPoint

import pytest

import mann_torch as mt
from mann_torch import registry
from mann_torch.registry import Registry

GROUP = "mann_torch.plants"


def plants(monkeypatch: pytest.MonkeyPatch, **points: str) -> Registry[mt.Plant]:
    """A registry of one plant, beside packages that register others."""

    def installed(group: str) -> list[EntryPoint]:
        assert group == GROUP
        return [EntryPoint(name, value, group) for name, value in points.items()]

    monkeypatch.setattr(registry, "entry_points", installed)
    return Registry("plant", mt.Plant, {"arm": mt.TwoLinkArm})


def test_a_registered_class_is_found_and_listed_after_the_librarys(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    known = plants(monkeypatch, swing="mann_torch.plants.pendulum:Pendulum")
    assert list(known) == ["arm", "swing"] and len(known) == 2
    assert "swing" in known and "other" not in known
    assert known["swing"].__name__ == "Pendulum" and known["swing"] is known["swing"]
    assert list(known) == ["arm", "swing"] and known.get("other") is None


def test_packages_are_asked_when_a_foreign_name_is_looked_for(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    known = plants(monkeypatch, broken="no.such.module:Plant")
    assert known["arm"] is mt.TwoLinkArm  # whatever others have installed
    assert list(known) == ["arm", "broken"]  # to list a name is not to load it


@pytest.mark.parametrize(
    ("value", "said"),
    [
        ("no.such.module:Plant", r"can't be loaded from no.such.module:Plant \(ModuleNotFoundErr"),
        ("mann_torch.plants:Gone", r"can't be loaded from .*AttributeError"),
        ("mann_torch.signals:Sinusoid", "mann_torch.signals:Sinusoid is no Plant"),
        ("math:pi", "math:pi is no Plant"),
    ],
)
def test_a_broken_entry_point_is_one_line_that_names_it(
    value: str, said: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    known = plants(monkeypatch, mine=value)
    with pytest.raises(mt.ConfigError, match=said) as raised:
        known["mine"]
    assert "\n" not in str(raised.value)
    assert str(raised.value).startswith(f"entry point {GROUP}: plant 'mine'")


def test_no_name_is_taken_over(monkeypatch: pytest.MonkeyPatch) -> None:
    known = plants(monkeypatch, arm="mann_torch.plants.pendulum:Pendulum")
    assert known["arm"] is mt.TwoLinkArm
    with pytest.raises(mt.ConfigError, match=r"plant 'arm' of .* has a name that the library has"):
        list(known)
    twice = [
        EntryPoint("swing", f"mann_torch.plants:{kind}", GROUP) for kind in ("Pendulum", "CartPole")
    ]
    monkeypatch.setattr(registry, "entry_points", lambda group: twice)
    with pytest.raises(mt.ConfigError, match=r"a name that mann_torch\.plants:Pendulum has"):
        Registry("plant", mt.Plant, {})["swing"]


def test_an_unknown_name_is_told_what_there_is(monkeypatch: pytest.MonkeyPatch) -> None:
    known = plants(monkeypatch, swing="mann_torch.plants:Pendulum")
    with pytest.raises(mt.ConfigError, match="unknown plant 'leg'; choose from arm, swing"):
        known["leg"]
