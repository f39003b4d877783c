"""Checks the array shapes in the annotations of `fit` while tests run."""

from jaxtyping import install_import_hook

install_import_hook("fit", "beartype.beartype")
