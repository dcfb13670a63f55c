"""Tab completion: the lines that `-sc install=bash` gives a shell."""

from __future__ import annotations

from pathlib import Path

#: COMP_LINE goes to the command itself, which names what could follow.
_SCRIPT = """\
_mann_completion() {
    local words=($COMP_LINE) helper
    if [[ "${words[0]##*/}" == python* ]]; then
        [[ "${words[1]}" == -m && "${words[2]}" == *experiments.* ]] || return 0
        helper="${words[0]} -m ${words[2]}"
    else
        helper="${words[0]}"
    fi
    local word=""
    [[ "$COMP_LINE" == *" " ]] || word="${words[${#words[@]}-1]}"
    local choices=$(COMP_LINE="$COMP_LINE" $helper -sc query=bash 2>/dev/null)
    COMPREPLY=($(compgen -W "$choices" -- "$word"))
}
COMP_WORDBREAKS=${COMP_WORDBREAKS//=}
complete -o nospace -o default -F _mann_completion NAMES"""


def script(program: str) -> str:
    """What a shell is to evaluate; `program` is argv[0]."""
    names = "python python3" if program.endswith(".py") else Path(program).name
    return _SCRIPT.replace("NAMES", names)
