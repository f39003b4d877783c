"""The commands that list what there is to explore with: objects and strategies.

Hands and arms are listed in `hands` and `arms`, beside the commands that make them.
"""

from sweeps.cli.app import Json, app


@app.command
def objects(*, json: Json = False) -> int:
    """List the objects of the catalogue.

    Parameters
    ----------
    json
        Print JSON.
    """
    from sweeps.text_table import print_table
    from warpgrasp.objects.catalogue_names import BODY_NAMES, FAMILY_NAMES, MOST_SEED

    families = [(f"{name}-SEED", f"{what}; SEED from 0 to {MOST_SEED}, see docs/objects.md [est]")
                for name, what in FAMILY_NAMES.items()]
    print_table(("object", "what"), [*BODY_NAMES.items(), *families], json)
    return 0


@app.command
def strategies(*, json: Json = False) -> int:
    """List the ready-made strategies.

    Parameters
    ----------
    json
        Print JSON.
    """
    from strategies.ready_made import STRATEGIES
    from sweeps.text_table import print_table

    print_table(("strategy", "what"), [(s.name, s.doc) for s in STRATEGIES.values()], json)
    return 0
