"""`servolink completion`: a script that completes commands, options, names and files in a shell."""

from __future__ import annotations

import argparse

from servolink.cli.command import DEVELOPERS, Command, option
from servolink.support import ExitCode

# Each script asks `servolink complete`, whose exit code 1 means that the name of a file is wanted.
_BASH = r"""
_servolink() {
    local found line
    COMPREPLY=()
    if found=$(command servolink complete bash -- "${COMP_LINE:0:COMP_POINT}" 2>/dev/null); then
        while IFS= read -r line; do
            [ -z "$line" ] || COMPREPLY+=("$line")
        done <<<"$found"
        case ${COMPREPLY-} in *=) compopt -o nospace ;; esac
    else
        compopt -o default
    fi
}
complete -F _servolink servolink
"""
_ZSH = r"""
#compdef servolink
_servolink() {
    local found
    local -a lines
    if found=$(command servolink complete zsh -- "${(@Q)words[2,CURRENT]}" 2>/dev/null); then
        lines=("${(@f)found}")
        compadd -S '' -- ${(M)lines:#*=}
        compadd -- ${lines:#*=}
    else
        _files
    fi
}
if [[ $funcstack[1] == _servolink ]]; then
    _servolink "$@"
else
    compdef _servolink servolink
fi
"""
_FISH = r"""
function __servolink_complete
    set -l words (commandline -opc) (commandline -ct)
    set -l found (command servolink complete fish -- $words[2..-1] 2>/dev/null)
    or begin
        __fish_complete_path (commandline -ct)
        return
    end
    printf '%s\n' $found
end
complete -c servolink -f -a '(__servolink_complete)'
"""
_SCRIPTS = {"bash": _BASH, "zsh": _ZSH, "fish": _FISH}


@Command(
    "completion",
    DEVELOPERS,
    help="print a script that completes commands in bash, zsh or fish",
    details="Save what it prints where your shell looks for it, and start a new shell:\n"
    "  bash  ~/.local/share/bash-completion/completions/servolink\n"
    "  zsh   _servolink, in a folder of $fpath\n"
    "  fish  ~/.config/fish/completions/servolink.fish",
    examples=("completion bash", "completion fish"),
    options=(option("shell", "bash|zsh|fish", "for which shell"),),
    takes_board=False,
)
def run(args: argparse.Namespace) -> int:
    """Print the script."""
    print(_SCRIPTS[args.shell].lstrip("\n"), end="", flush=True)
    return ExitCode.OK
