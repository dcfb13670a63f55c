"""What the claims ask to be simulated."""

OURS, ALWAYS, STATE = (
    "reallocating_initial",
    "reallocating_always",
    "reallocating_initial_state_keys",
)

_TABLES = [(s, v) for s in "12345" for v in ("nn", "soft", OURS, "hard")]
CLAIM_RUNS: list[tuple[str, str]] = [
    *_TABLES,
    *[("6", v) for v in ("nn", "hard", OURS)],
    *[(s, v) for s in ("4_offset", "1_long_arm", "4_long_arm") for v in ("hard", OURS)],
    *[(s, STATE) for s in "14"],
    *[("illustration", v) for v in ("nn", "soft", "hard", OURS, ALWAYS)],
]
