"""Scripts that are no part of the package."""

from importlib.util import module_from_spec, spec_from_file_location


def loaded(path):
    """The module of a file."""
    spec = spec_from_file_location(path.stem, path)
    module = module_from_spec(spec)
    spec.loader.exec_module(module)
    return module
