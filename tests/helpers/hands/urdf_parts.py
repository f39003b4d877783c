"""Links and joints of a URDF as text."""

from collections.abc import Iterable

BALL = '<collision><geometry><sphere radius="0.01"/></geometry></collision>'


def link(name: str, inside: str = BALL) -> str:
    return f'<link name="{name}">{inside}</link>'


def joint(name: str, parent: str, child: str, *, kind: str = "revolute", at: str = "0 0 0.03",
          limit: str = '<limit lower="0" upper="1" effort="1" velocity="1"/>', more: str = "",
          axis: str = "0 1 0") -> str:
    return (f'<joint name="{name}" type="{kind}"><parent link="{parent}"/><child link="{child}"/>'
            f'<origin xyz="{at}"/><axis xyz="{axis}"/>{limit}{more}</joint>')


def robot(parts: Iterable[str]) -> str:
    """The whole file."""
    return f'<robot name="x">{"".join(parts)}</robot>'
