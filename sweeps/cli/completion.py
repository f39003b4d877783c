"""`warpgrasp completion bash|zsh`: a script for the shell that completes commands and options."""

from sweeps.spec.errors import choose

_BASH = """\
_warpgrasp() {{
    local word="${{COMP_WORDS[COMP_CWORD]}}" command="${{COMP_WORDS[1]}}" words=""
    if [ "$COMP_CWORD" -eq 1 ]; then
        words="{commands}"
    else
        case "$command" in
{cases}
        esac
    fi
    COMPREPLY=($(compgen -W "$words" -- "$word") $(compgen -f -- "$word"))
}}
complete -o filenames -F _warpgrasp warpgrasp
"""
KINDS = {
    "table": ("pairs", "objects", "confusion", "curves", "reach", "same-time", "pareto",
              "settings"),
    "figure": ("forest", "curves-touches", "curves-time", "pareto", "confusion", "settings",
               "contacts", "faces", "contour", "taxels", "grasp"),
    "fit": ("superquadric", "plane", "revolution"),
}


def completion(shell: str) -> str:
    """The script; put `source <(warpgrasp completion bash)` into ~/.bashrc."""
    if shell not in ("bash", "zsh"):
        raise ValueError(f"there is no completion for {shell!r}; {choose(shell, ['bash', 'zsh'])}")
    options = command_options()
    cases = "\n".join(f'            {name}) words="{" ".join([*KINDS.get(name, ()), *found])}" ;;'
                      for name, found in options.items())
    text = _BASH.format(commands=" ".join(options), cases=cases)
    if shell == "zsh":
        text = "autoload -U +X bashcompinit && bashcompinit\n" + text
    return text


def command_options() -> dict[str, list[str]]:
    """The options of every command, by its name, read from the command line itself."""
    from sweeps.cli.app import app

    found: dict[str, list[str]] = {}
    for name in sorted(app):
        if name.startswith("-"):
            continue
        arguments = app[name].assemble_argument_collection()
        found[name] = sorted({option for argument in arguments for option in argument.names
                              if option.startswith("--")} | {"--help", "--quiet"})
    return found
