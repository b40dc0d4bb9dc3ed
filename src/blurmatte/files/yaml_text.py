"""YAML in which programs write calibrations: mappings, lists and scalars, read by PyYAML.

Tags such as `!!opencv-matrix` are skipped. Aliases are refused, since a short text could stand for a
huge one.
"""

import re
from typing import Any

import yaml

# The directive of OpenCV, which no version of YAML has.
_OPENCV_DIRECTIVE = re.compile(r"\A%YAML:1\.0\s*")
# PyYAML reads 1e-5 as a text: YAML 1.1 asks for a point.
_NUMBER = re.compile(r"[-+]?(\d+\.?\d*|\.\d+)([eE][-+]?\d+)?$")
_FLOAT = "tag:yaml.org,2002:float"


def parse_yaml(text: str) -> Any:
    """Mappings, lists, numbers, texts, true, false and null; ValueError for anything else."""
    try:
        documents = list(yaml.load_all(_OPENCV_DIRECTIVE.sub("", text), _Loader))
    except yaml.MarkedYAMLError as error:
        line = "" if error.problem_mark is None else f" in line {error.problem_mark.line + 1}"
        raise ValueError(f"{error.problem or error.context}{line}") from error
    except yaml.YAMLError as error:
        raise ValueError(str(error).splitlines()[0]) from error
    except RecursionError as error:
        raise ValueError("it is nested too deep") from error
    found = [one for one in documents if one is not None]  # messages of ROS end with a separator
    if len(found) > 1:
        raise ValueError(f"leave one of its {len(found)} documents")
    return found[0] if found else None


class _Loader(yaml.SafeLoader):
    """Without aliases, repeated keys and types of tags; with numbers as all programs write them."""

    def compose_node(self, parent: Any, index: Any) -> Any:
        """A node, or a MarkedYAMLError at an alias."""
        if self.check_event(yaml.AliasEvent):
            mark = self.get_event().start_mark  # type: ignore[no-untyped-call]
            raise yaml.MarkedYAMLError(problem="aliases are not supported", problem_mark=mark)
        return super().compose_node(parent, index)


def _mapping(loader: _Loader, node: yaml.MappingNode) -> dict[str, Any]:
    """The pairs of a mapping; keys are texts."""
    found: dict[str, Any] = {}
    for key_node, value_node in node.value:
        key = str(loader.construct_object(key_node, deep=True))
        if key in found:
            raise yaml.MarkedYAMLError(
                problem=f"it has the key {key} twice", problem_mark=key_node.start_mark
            )
        found[key] = loader.construct_object(value_node, deep=True)
    return found


def _plain(loader: _Loader, node: yaml.Node) -> Any:
    """The value of a node, whatever its tag."""
    if isinstance(node, yaml.MappingNode):
        return _mapping(loader, node)
    if isinstance(node, yaml.SequenceNode):
        return loader.construct_sequence(node, deep=True)
    return loader.construct_scalar(node)  # type: ignore[arg-type]


_Loader.add_constructor("tag:yaml.org,2002:map", _mapping)
for _type in ("binary", "omap", "pairs", "set", "timestamp"):
    _Loader.add_constructor(f"tag:yaml.org,2002:{_type}", _plain)
_Loader.add_multi_constructor("", lambda loader, _, node: _plain(loader, node))
_Loader.add_implicit_resolver(_FLOAT, _NUMBER, list("-+0123456789."))
