"""Gives the generated configuration dataclasses typed default values.

The code generator copies defaults from the JSON schema as plain dictionaries and lists, so that
``EnvConfig().arm.wheel`` would be a dictionary although it is annotated as a dataclass. This pass
rewrites each default in place: dictionaries become the dataclass that the annotation names (for a
union, the member whose literal tag agrees), arguments equal to that class's own defaults are left
out, and lists become tuples, so that instances are immutable all the way down.

Usage: ``python tools/typed_defaults.py FILE`` rewrites FILE.
"""

from __future__ import annotations

import ast
import os
import sys
from pathlib import Path
from typing import Any

Fields = dict[str, ast.AnnAssign]


class Module:
    """The dataclasses and type aliases of one generated module."""

    def __init__(self, tree: ast.Module) -> None:
        self.classes: dict[str, Fields] = {}
        self.aliases: dict[str, ast.expr] = {}
        for node in tree.body:
            if isinstance(node, ast.ClassDef):
                self.classes[node.name] = {
                    item.target.id: item
                    for item in node.body
                    if isinstance(item, ast.AnnAssign) and isinstance(item.target, ast.Name)
                }
            elif isinstance(node, ast.AnnAssign) and isinstance(node.target, ast.Name):
                assert node.value is not None, f"line {node.lineno}: an alias without a value"
                self.aliases[node.target.id] = node.value

    def members(self, annotation: ast.expr) -> list[ast.expr]:
        """The members of a union, with aliases replaced by what they stand for."""
        if isinstance(annotation, ast.BinOp):
            return self.members(annotation.left) + self.members(annotation.right)
        if isinstance(annotation, ast.Name) and annotation.id in self.aliases:
            return self.members(self.aliases[annotation.id])
        return [annotation]

    def class_for(self, value: dict[str, Any], annotation: ast.expr) -> str | None:
        """The dataclass that `value` is an instance of, or None where a mapping is meant."""
        names = [
            member.id
            for member in self.members(annotation)
            if isinstance(member, ast.Name) and member.id in self.classes
        ]
        fitting = [name for name in names if self._fits(value, self.classes[name])]
        if len(fitting) > 1:
            raise ValueError(f"default {value!r} fits several classes: {', '.join(fitting)}")
        if names and not fitting:
            raise ValueError(f"default {value!r} fits none of {', '.join(names)}")
        return fitting[0] if fitting else None

    @staticmethod
    def _fits(value: dict[str, Any], fields: Fields) -> bool:
        if not value.keys() <= fields.keys():
            return False
        for name, field in fields.items():
            kind = field.annotation
            if isinstance(kind, ast.Subscript) and ast.unparse(kind.value) == "Literal":
                tags = ast.literal_eval(kind.slice)
                given = value.get(name, plain(field.value))
                if given not in (tags if isinstance(tags, tuple) else (tags,)):
                    return False
            if field.value is None and name not in value:
                return False
        return True

    def render(self, value: Any, annotation: ast.expr) -> str:
        """Source text of `value` as an instance of `annotation`."""
        if isinstance(value, dict):
            name = self.class_for(value, annotation)
            if name is None:
                # the generator writes an empty list as an empty dictionary
                return repr(value) if value or self._sequence(annotation) is None else "()"
            fields = self.classes[name]
            arguments = []
            for key, item in value.items():
                text = self.render(item, fields[key].annotation)
                if text != self.default_of(fields[key]):
                    arguments.append(f"{key}={text}")
            return f"{name}({', '.join(arguments)})"
        if isinstance(value, list):
            sequence = self._sequence(annotation)
            parts = [
                self.render(item, self._item(sequence, index)) for index, item in enumerate(value)
            ]
            return f"({', '.join(parts)}{',' if len(parts) == 1 else ''})"
        return repr(value)

    def default_of(self, field: ast.AnnAssign) -> str | None:
        """Source text of the field's default after this pass; None if it has none."""
        if field.value is None:
            return None
        return self.render(plain(field.value), field.annotation)

    def _sequence(self, annotation: ast.expr) -> ast.Subscript | None:
        for member in self.members(annotation):
            if isinstance(member, ast.Subscript):
                name = ast.unparse(member.value)
                if name in {"Sequence", "list", "tuple"}:
                    return member
        return None

    @staticmethod
    def _item(sequence: ast.Subscript | None, index: int) -> ast.expr:
        if sequence is None:
            return ast.Name("Any")
        if isinstance(sequence.slice, ast.Tuple):
            return sequence.slice.elts[index]
        return sequence.slice


def plain(node: ast.expr | None) -> Any:
    """The JSON value that a default stands for, whichever way the generator wrote it."""
    if isinstance(node, ast.Call) and ast.unparse(node.func) == "field":
        (keyword,) = node.keywords
        value = keyword.value
        return plain(value.body if isinstance(value, ast.Lambda) else ast.Call(value, [], []))
    if isinstance(node, ast.Call):
        return {str(keyword.arg): plain(keyword.value) for keyword in node.keywords}
    if isinstance(node, ast.Dict):
        return {
            ast.literal_eval(key): plain(item)
            for key, item in zip(node.keys, node.values, strict=True)
            if key is not None
        }
    if isinstance(node, ast.List):
        return [plain(item) for item in node.elts]
    return None if node is None else ast.literal_eval(node)


def rewrite(source: str) -> str:
    """The module `source` with typed defaults."""
    tree = ast.parse(source)
    module = Module(tree)
    lines = source.encode().splitlines(keepends=True)
    starts = [0]
    for line in lines:
        starts.append(starts[-1] + len(line))
    edits: list[tuple[int, int, str]] = []
    for fields in module.classes.values():
        for field in fields.values():
            node = field.value
            if not isinstance(node, ast.Call):
                continue
            text = module.render(plain(node), field.annotation)
            if text.startswith("{"):
                text = f"field(default_factory=lambda: {text})"
            assert node.end_lineno is not None and node.end_col_offset is not None
            begin = starts[node.lineno - 1] + node.col_offset
            end = starts[node.end_lineno - 1] + node.end_col_offset
            edits.append((begin, end, text))
    data = source.encode()
    for begin, end, text in sorted(edits, reverse=True):
        data = data[:begin] + text.encode() + data[end:]
    return data.decode()


def main() -> None:
    """Rewrites the file named on the command line."""
    path = Path(sys.argv[1])
    text = rewrite(path.read_text(encoding="utf-8"))
    scratch = path.with_name(path.name + ".new")
    scratch.write_text(text, encoding="utf-8")
    os.replace(scratch, path)


if __name__ == "__main__":
    main()
