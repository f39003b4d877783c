"""The house rules that a reader should not have to remember: who may import whom."""

import ast
from pathlib import Path

import pytest

ROOT = Path(__file__).parent.parent
MAY_IMPORT = {
    "warpgrasp": {"warpgrasp"},
    "fit": {"fit"},
    "strategies": {"strategies", "warpgrasp", "fit"},
    "sweeps": {"sweeps", "strategies", "warpgrasp", "fit"},
}


def imported_roots(path: Path) -> set[str]:
    roots: set[str] = set()
    for node in ast.walk(ast.parse(path.read_text())):
        if isinstance(node, ast.Import):
            roots |= {alias.name.split(".")[0] for alias in node.names}
        elif isinstance(node, ast.ImportFrom):
            assert node.level == 0, f"{path}: relative import; name the package"
            roots.add((node.module or "").split(".")[0])
    return roots


@pytest.mark.parametrize("package", MAY_IMPORT)
def test_imports_go_one_way(package: str) -> None:
    for path in sorted((ROOT / package).rglob("*.py")):
        ours = imported_roots(path) & set(MAY_IMPORT)
        assert ours <= MAY_IMPORT[package], f"{path} imports {ours - MAY_IMPORT[package]}"


def test_jaxopt_lives_in_one_file() -> None:
    users = [p for name in MAY_IMPORT for p in (ROOT / name).rglob("*.py")
             if "jaxopt" in imported_roots(p)]
    assert len(users) <= 1, users


def test_warmup_compiles_every_file_with_a_kernel() -> None:
    from sweeps.warmup import KERNEL_MODULES

    files = {p for name in MAY_IMPORT for p in (ROOT / name).rglob("*.py")
             if "@wp.kernel" in p.read_text()}
    assert {str(p.relative_to(ROOT))[:-3].replace("/", ".") for p in files} == set(KERNEL_MODULES)
