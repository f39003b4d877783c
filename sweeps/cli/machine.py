"""The commands for this machine: its installation, compiled programs and shell."""

from typing import Literal

from sweeps.cli.app import Json, app, device_of


@app.command
def doctor(*, test: bool = True, json: Json = False) -> int:
    """Check the installation, the caches and the devices; exit with 1 if a check fails.

    Parameters
    ----------
    test
        Also compute a distance and a fit (seconds; the first time compiles).
    json
        Print JSON.
    """
    from sweeps.cli.tools.doctor import doctor as examine

    return examine(as_json=json, test=test)


@app.command
def warmup(*, device: str = "cpu") -> int:
    """Compile the kernels and the programs of the fits into the caches, once for a version.

    Parameters
    ----------
    device
        cpu, or cuda:0.
    """
    from sweeps.cli.warmup import warmup as compile_all

    return compile_all(device_of(device))


@app.command
def completion(shell: Literal["bash", "zsh", "fish"], /) -> int:
    """Print a script that completes commands and options: source <(warpgrasp completion bash).

    Parameters
    ----------
    shell
        bash, zsh or fish.
    """
    script = app.generate_completion(shell=shell)
    if shell == "bash":  # words that match none of the choices complete as files
        script = script.replace("complete -F", "complete -o default -F")
    print(script, end="")
    return 0
