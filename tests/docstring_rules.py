"""Rules for docstrings, checked on source text: importing would hide what decorators replace."""

import ast
import functools
import re
from collections.abc import Iterator
from typing import NamedTuple

NUMBERS = {"Array", "Matrix", "Scalar", "Vector", "float", "ndarray"}  # annotations of what has a shape or a unit
AXIS = r"(?:\.\.\.|[A-Za-z]\w{0,6}|\d+)"
SHAPE = re.compile(rf"\((?:{AXIS}, ?)+{AXIS}?\)|\(\.\.\.\)|\b\w x \w\b|of one length|\b[Ss]calars?\b")
UNIT = re.compile(r"\[[^\[\]]+\]")
QUESTION = re.compile(r"(What|Which|How|Whether|Where|When|Why)\b")
ARGUMENTS = re.compile(r"^Args:\n((?: {4,}.*\n?|\n)+)", flags=re.MULTILINE)
ENTRY = re.compile(r" {4}\*{0,2}(\w+): ")
EQUATIONS = re.compile(r"\((\d{1,2})\)(?:-\((\d{1,2})\))?")


parsed = functools.cache(ast.parse)  # a module's source, which several rules read


class Definition(NamedTuple):
    """A public class or function of a module."""

    name: str  # dotted, from the module on
    node: ast.ClassDef | ast.FunctionDef
    owner: ast.ClassDef | None  # of a method
    raises: bool  # UserError, by itself or through private functions of its module


def definitions(module: str, source: str) -> list[Definition]:
    """The public classes, functions, methods and properties that a module defines."""
    tree = parsed(source)
    raising = _raising(tree)
    found = []

    def collect(body, prefix, owner):
        for node in body:
            if isinstance(node, ast.ClassDef | ast.FunctionDef) and not node.name.startswith("_"):
                found.append(Definition(f"{prefix}.{node.name}", node, owner, node in raising))
                if isinstance(node, ast.ClassDef):
                    collect(node.body, f"{prefix}.{node.name}", node)

    collect(tree.body, module, None)
    return found


def complaints(definition: Definition) -> list[str]:
    """Faults of the docstring of a definition."""
    doc = ast.get_docstring(definition.node)
    if not doc:
        return [f"{definition.name}: no docstring"]
    if isinstance(definition.node, ast.ClassDef):
        return []
    said = []
    around = ast.get_docstring(definition.owner) or "" if definition.owner else ""
    if _has_numbers(definition.node) and not (SHAPE.search(doc + around) or UNIT.search(doc + around)):
        said.append(f"{definition.name}: neither shape, as (n,), nor unit, as [N m]")
    if definition.raises and not re.search(r"^Raises:\n +UserError: ", doc, flags=re.MULTILINE):
        said.append(f"{definition.name}: raises UserError and has no line for it below Raises:")
    return said


def wording(module: str, source: str) -> list[str]:
    """Complaints about how the docstrings of a module, private ones included, begin and list arguments."""
    said = []
    for node in ast.walk(parsed(source)):
        if not isinstance(node, ast.Module | ast.ClassDef | ast.FunctionDef):
            continue
        doc, name = ast.get_docstring(node) or "", f"{module}.{getattr(node, 'name', '')}".rstrip(".")
        if QUESTION.match(doc):
            said.append(f"{name}: begins like a question, not with a verb or a noun: {doc.splitlines()[0]}")
        if isinstance(node, ast.FunctionDef) and (block := ARGUMENTS.search(doc)):
            said += [f"{name}: {complaint}" for complaint in _listed(node, block[1])]
    return said


def _listed(function: ast.FunctionDef, block: str) -> Iterator[str]:
    """Complaints about the lines below Args."""
    arguments = function.args
    several = [argument for argument in (arguments.vararg, arguments.kwarg) if argument is not None]
    known = {each.arg for each in [*arguments.posonlyargs, *arguments.args, *arguments.kwonlyargs, *several]}
    for line in block.splitlines():
        found = ENTRY.match(line)
        inside = set(re.findall(r"(?:[.;\]] |, )(\w+): ", line)) & known
        if line.strip() and not line.startswith(" " * 5) and not (found and found[1] in known):
            yield f"below Args, not one of its arguments and a colon: {line.strip()}"
        elif inside:
            yield f"several arguments on one line: {line.strip()}"


def equations(source: str) -> set[int]:
    """Numbers of the equations that a module's docstrings name."""
    nodes = ast.walk(parsed(source))
    documented = (node for node in nodes if isinstance(node, ast.Module | ast.ClassDef | ast.FunctionDef))
    return numbers("\n".join(ast.get_docstring(node) or "" for node in documented))


def numbers(text: str) -> set[int]:
    """Numbers of the equations in a text, ranges like (12)-(15) filled."""
    pairs = ((int(first), int(last or first)) for first, last in EQUATIONS.findall(text))
    return {number for first, last in pairs for number in range(first, last + 1)}


def _raising(tree: ast.Module) -> set[ast.FunctionDef]:
    """Functions out of which a UserError of this module comes: their own, or that of a private function they call."""
    functions = [node for node in ast.walk(tree) if isinstance(node, ast.FunctionDef)]
    raising = {f for f in functions if any(map(_raises_user_error, _uncaught(f)))}
    while True:
        private = {f.name for f in raising if f.name.startswith("_")}
        more = {f for f in functions if any(_calls(node, private) for node in _uncaught(f))} - raising
        if not more:
            return raising
        raising |= more


def _uncaught(node: ast.AST) -> Iterator[ast.AST]:
    """A node and all within it, but for what stands in a ``try`` that catches UserError."""
    yield node
    caught = isinstance(node, ast.Try) and any("UserError" in ast.unparse(h.type) for h in node.handlers if h.type)
    for child in ast.iter_child_nodes(node):
        if not (caught and child in node.body):
            yield from _uncaught(child)


def _raises_user_error(node: ast.AST) -> bool:
    return isinstance(node, ast.Raise) and isinstance(node.exc, ast.Call) and ast.unparse(node.exc.func) == "UserError"


def _calls(node: ast.AST, names: set[str]) -> bool:
    return isinstance(node, ast.Call) and isinstance(node.func, ast.Name) and node.func.id in names


def _has_numbers(function: ast.FunctionDef) -> bool:
    arguments = [*function.args.posonlyargs, *function.args.args, *function.args.kwonlyargs]
    annotations = [argument.annotation for argument in arguments] + [function.returns]
    names = {
        node.id if isinstance(node, ast.Name) else node.attr
        for annotation in annotations
        if annotation is not None
        for node in ast.walk(annotation)
        if isinstance(node, ast.Name | ast.Attribute)
    }
    return bool(NUMBERS & names)
