"""Opening finished or half-finished studies to read them."""

from collections.abc import Sequence
from pathlib import Path

from sweeps.plan import Plan, plan_study, study_of
from sweeps.store import Store
from sweeps.store_error import OtherStudy, StoreError


def open_study(folders: Sequence[Path]) -> tuple[Plan, list[Store]]:
    """The study of one directory, or of several that hold parts of it.

    Raises OtherStudy where they are not of one study, StoreError where one cannot be read.
    """
    stores = [Store(folder) for folder in folders]
    found = [store.resolved() for store in stores]
    for store, resolved in zip(stores, found, strict=True):
        if resolved["hash"] != found[0]["hash"]:
            raise OtherStudy(store.folder, [f"hash: {found[0]['hash']} ({folders[0]}) -> "
                                            f"{resolved['hash']} ({store.folder})"])
    return plan_of(stores[0]), stores


def plan_of(store: Store) -> Plan:
    """The plan that a directory's `resolved.json` holds."""
    resolved = store.resolved()
    try:
        plan = plan_study(study_of(resolved["study"], resolved.get("name", "")))
    except (KeyError, TypeError, ValueError):
        plan = None
    if plan is None or plan.hash != resolved["hash"]:
        raise StoreError(f"{store.folder}/resolved.json: was written by another version, or "
                         "altered; run the sweep again in a new directory")
    return plan
