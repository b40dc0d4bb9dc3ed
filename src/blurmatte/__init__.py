"""blurmatte: alpha and color of motion-blurred objects over a known background.

Linear light in, linear light out; see the docstring of each name. The stub `__init__.pyi` lists the
public names, and the packages with further ones, such as `blurmatte.motion.fit_fall`. Each is imported
when it is first used, so that `import blurmatte` is fast.
"""

import re
import sys
from importlib import import_module
from pathlib import Path
from types import ModuleType

__version__ = "0.1.0"

_STUB = Path(__file__).with_suffix(".pyi").read_text(encoding="utf-8")
_PACKAGES = {
    name: package for package, name in re.findall(r"(?m)^from (\S+) import (\w+) as", _STUB)
}


__all__ = sorted(_PACKAGES)


def __getattr__(name: str) -> object:
    """A public name, imported from its module, or a package of such names."""
    if name not in _PACKAGES:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    if _PACKAGES[name] == __name__:
        return import_module(f"{__name__}.{name}")
    value = globals()[name] = getattr(import_module(_PACKAGES[name]), name)
    return value


def __dir__() -> list[str]:
    return [*__all__, "__version__"]


class _Package(ModuleType):
    """Keeps a public name when the import system binds a subpackage of the same name."""

    def __setattr__(self, name: str, value: object) -> None:
        if _PACKAGES.get(name, __name__) == __name__ or not isinstance(value, ModuleType):
            super().__setattr__(name, value)


sys.modules[__name__].__class__ = _Package
