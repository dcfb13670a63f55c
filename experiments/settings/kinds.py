"""Values of the wrong kind, told in the words of all other errors."""

from __future__ import annotations

#: What OmegaConf says of a value of another kind than its setting, and what to say instead.
_WANTED = {
    "to Integer": "give a whole number",
    "to Float": "give a number",
    "not a valid bool": "give true or false",
    "to string": "give a text",
    "is not Optional": "give a value, it can't be null",
    "is not a subclass of": "it holds settings of its own; give one of them, as NAME.SETTING=VALUE",
    "not an instance of": "it holds settings of its own; give one of them, as NAME.SETTING=VALUE",
}


def wrong_kind(name: str, value: object, told: str) -> str | None:
    """What to say of a value of the wrong kind; None where OmegaConf `told` of another thing."""
    wanted = next((wanted for sign, wanted in _WANTED.items() if sign in told), None)
    return None if wanted is None else f"{name} = {value}: {wanted.replace('NAME', name)}"
