"""The materials in JavaScript, made from their Python: `python -m tools.port` writes materials.js.

The kernels of ldsim/mechanics/materials are scalars and tuples in a small part of Python, which says the same in
JavaScript, with arrays for tuples. Only that part is known here; whatever else a material used is refused by name.
"""

from __future__ import annotations

import ast
from functools import cache
from pathlib import Path

import ldsim
from ldsim.mechanics.materials import MATERIALS
from ldsim.web import PAGE_MATERIALS

FOLDER = Path(ldsim.__file__).parent / "mechanics" / "materials"
TARGET = Path(ldsim.__file__).parent / "web" / "src" / "generated" / "materials.js"
PACKAGE = "ldsim.mechanics.materials"

OPERATORS: dict[type[ast.AST], str] = {
    ast.Add: "+", ast.Sub: "-", ast.Mult: "*", ast.Div: "/", ast.Pow: "**", ast.Mod: "%", ast.And: "&&", ast.Or: "||",
    ast.Lt: "<", ast.LtE: "<=", ast.Gt: ">", ast.GtE: ">=", ast.Eq: "===", ast.NotEq: "!==", ast.USub: "-",
    ast.Not: "!",
}  # fmt: skip
BUILTINS = {"abs": "Math.abs", "max": "Math.max", "min": "Math.min", "float": "Number"}
CONSTANTS = {True: "true", False: "false", None: "null"}
# What JavaScript has under another name, or has of its own where Python's works on the bits of a number.
OWN = {
    "math.inf": "Infinity",
    "math.copysign": "((size, sign) => (sign < 0 || Object.is(sign, -0) ? -size : size))",
    "tensors.inverse_cube_root": "((x) => 1 / Math.cbrt(x))",
}

HEAD = "// Made by `python -m tools.port` from ldsim/mechanics/materials: change that, not this.\n\n"
TAIL = """
/** The material of a number, as Python numbers them. */
export function material(number) {
  if (!MATERIALS[number]) throw new Error(`no material has the number ${number}`);
  return MATERIALS[number];
}
"""


class PortError(ValueError):
    """A kernel uses what this translation does not know."""


class Module:
    """One file of materials: its top-level statements by the names that they bind, and what it imports."""

    def __init__(self, name: str) -> None:
        self.name = name
        self.statements: dict[str, ast.stmt] = {}
        self.imported: dict[str, str] = {}
        for node in ast.parse((FOLDER / f"{name}.py").read_text(encoding="utf-8")).body:
            if isinstance(node, ast.ImportFrom) and (node.module or "").startswith(PACKAGE):
                source = (node.module or "").removeprefix(PACKAGE).removeprefix(".")
                self.imported |= {alias.name: f"{source}.{alias.name}".removeprefix(".") for alias in node.names}
            elif isinstance(node, ast.FunctionDef):
                self.statements[node.name] = node
            elif isinstance(node, ast.Assign):
                self.statements |= dict.fromkeys(_bound(node.targets), node)


@cache
def module(name: str) -> Module:
    """A file of materials, read once."""
    return Module(name)


def _bound(targets: list[ast.expr]) -> list[str]:
    return [node.id for target in targets for node in ast.walk(target) if isinstance(node, ast.Name)]


def _spread(target: ast.expr, value: str) -> str:
    """Assignments of a value's entries to the names of a target."""
    if isinstance(target, ast.Tuple):
        return "".join(_spread(part, f"{value}[{i}]") for i, part in enumerate(target.elts))
    return f"{ast.unparse(target)} = {value};\n"


class Port:
    """Translates one name of a module after another, what each needs before it."""

    def __init__(self) -> None:
        self.lines: list[str] = []
        self._done: set[ast.stmt] = set()
        self._module = module("tensors")
        self._local: set[str] = set()

    def add(self, name: str, of: str) -> str:
        """The JavaScript name of what module `of` calls `name`, which is translated if it has not been."""
        if own := OWN.get(f"{of}.{name}"):
            return own
        where = module(of)
        if name in where.imported:
            source, _, original = where.imported[name].rpartition(".")
            return self.add(original, source)
        if name not in where.statements:
            raise PortError(f"{of}.py uses {name!r}, which has no translation to JavaScript")
        node = where.statements[name]
        if node not in self._done:
            self._done.add(node)
            outer = self._module, self._local
            self._module, self._local = where, set()
            text = self.statement(node)
            self._module, self._local = outer
            self.lines.append(text)
        return f"{of}_{name}"

    def statement(self, node: ast.stmt) -> str:
        """A statement in JavaScript; a docstring becomes nothing."""
        say = self.expression
        match node:
            case ast.FunctionDef():
                return self._function(node)
            case ast.Assign():
                return self._assignment(node)
            case ast.AugAssign():
                return f"{say(node.target)} {OPERATORS[type(node.op)]}= {say(node.value)};\n"
            case ast.If():
                otherwise = f"else {{\n{self.block(node.orelse)}}}\n" if node.orelse else ""
                return f"if ({say(node.test)}) {{\n{self.block(node.body)}}}\n{otherwise}"
            case ast.For(iter=ast.Call(ast.Name("range"), [stop])):
                i = say(node.target)
                return f"for ({i} = 0; {i} < {say(stop)}; {i}++) {{\n{self.block(node.body)}}}\n"
            case ast.Return():
                return f"return {say(node.value) if node.value else ''};\n"
            case ast.Break():
                return "break;\n"
            case ast.Expr():
                return ""
        raise self._unknown(node)

    def block(self, nodes: list[ast.stmt]) -> str:
        return "".join(map(self.statement, nodes))

    def _function(self, node: ast.FunctionDef) -> str:
        names = [argument.arg for argument in node.args.args]
        top = not self._local
        outer, self._local = self._local, self._local | set(names)
        fresh = {name for part in ast.walk(node) if isinstance(part, ast.Assign) for name in _bound(part.targets)}
        fresh |= {name for part in ast.walk(node) if isinstance(part, ast.For) for name in _bound([part.target])}
        self._local |= fresh | {part.name for part in node.body if isinstance(part, ast.FunctionDef)}
        declared = f"let {', '.join(sorted(fresh - set(names)))};\n" if fresh - set(names) else ""
        body = declared + self.block(node.body)
        self._local = outer
        name = f"{self._module.name}_{node.name}" if top else node.name
        return f"function {name}({', '.join(names)}) {{\n{body}}}\n"

    def _assignment(self, node: ast.Assign) -> str:
        value = self.expression(node.value)
        if self._local:
            (target,) = node.targets
            if isinstance(target, ast.Name):
                return _spread(target, value)
            return f"{{ const all = {value};\n{_spread(target, 'all')}}}\n"  # JavaScript takes arrays apart slowly
        bound = [f"{self._module.name}_{name}" for name in _bound(node.targets)]
        return f"const {bound[0] if len(bound) == 1 else '[' + ', '.join(bound) + ']'} = {value};\n"

    def expression(self, node: ast.expr) -> str:
        """An expression in JavaScript, in brackets where the order of operations could differ."""
        say = self.expression
        match node:
            case ast.Constant(value):
                return CONSTANTS[value] if isinstance(value, bool | None) else repr(value)
            case ast.Name(name):
                return name if name in self._local else BUILTINS.get(name) or self.add(name, self._module.name)
            case ast.Attribute(ast.Name("math")):
                text = ast.unparse(node)
                return OWN.get(text, text.replace("math.", "Math."))
            case ast.BinOp():
                return f"({say(node.left)} {OPERATORS[type(node.op)]} {say(node.right)})"
            case ast.UnaryOp():
                return f"({OPERATORS[type(node.op)]}{say(node.operand)})"
            case ast.BoolOp():
                return f"({f' {OPERATORS[type(node.op)]} '.join(map(say, node.values))})"
            case ast.Compare():
                sides, signs = [*map(say, (node.left, *node.comparators))], [OPERATORS[type(op)] for op in node.ops]
                pairs = zip(sides, signs, sides[1:], strict=False)
                return f"({' && '.join(f'{a} {sign} {b}' for a, sign, b in pairs)})"
            case ast.IfExp():
                return f"({say(node.test)} ? {say(node.body)} : {say(node.orelse)})"
            case ast.Tuple():
                return f"[{', '.join(map(say, node.elts))}]"
            case ast.Starred():
                return f"...{say(node.value)}"
            case ast.Subscript():
                return f"{say(node.value)}[{say(node.slice)}]"
            case ast.Call():
                return f"{say(node.func)}({', '.join(map(say, node.args))})"
        raise self._unknown(node)

    def _unknown(self, node: ast.stmt | ast.expr) -> PortError:
        where, what = f"{self._module.name}.py, line {node.lineno}", ast.unparse(node).splitlines()[0]
        return PortError(f"{where}: {type(node).__name__} {what!r} has no translation")


def materials_script() -> str:
    """An ES module whose `material(number)` is { energyStress(F, mu, lam), tangent(F, mu, lam, clamp) }.

    Raises:
        PortError: a kernel uses what has no translation.
    """
    port = Port()
    entries = ""
    for name in PAGE_MATERIALS:
        stress, tangent = port.add("energy_stress", name), port.add("tangent", name)
        entries += f"{MATERIALS[name]}: {{ energyStress: {stress}, tangent: {tangent} }},\n"
    return f"{HEAD}{''.join(port.lines)}const MATERIALS = {{\n{entries}}};\n{TAIL}"


if __name__ == "__main__":
    TARGET.parent.mkdir(exist_ok=True)
    TARGET.write_text(materials_script(), encoding="utf-8")
