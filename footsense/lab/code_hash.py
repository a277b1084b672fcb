"""A hash of the code that measures a study's numbers, unchanged by comments, prose and renamed identifiers.

It covers the function `compute` and whatever of the same module that uses. Names that only the template uses are left
out: its text is compared byte by byte. A change in an imported module shows only once the numbers are computed again.
"""

import ast
import hashlib
from importlib.util import find_spec
from pathlib import Path


class _Normalise(ast.NodeTransformer):
    """Number identifiers by first appearance; drop annotations and prose (strings with blanks)."""

    def __init__(self) -> None:
        self._numbers: dict[str, str] = {}

    def generic_visit(self, node: ast.AST) -> ast.AST:
        """Return the node with numbered identifiers."""
        for name, value in ast.iter_fields(node):
            if name in {"annotation", "returns"}:
                setattr(node, name, None)
            elif isinstance(value, str) and name in {"id", "attr", "arg", "name"}:
                setattr(node, name, self._numbers.setdefault(value, f"_{len(self._numbers)}"))
        if isinstance(node, ast.Constant) and isinstance(node.value, str) and " " in node.value:
            return ast.Constant("")
        return super().generic_visit(node)


def _defined(statement: ast.stmt) -> set[str]:
    """Return the names that a statement of a module defines, without imports."""
    if isinstance(statement, ast.ClassDef | ast.FunctionDef):
        return {statement.name}
    if isinstance(statement, ast.Assign | ast.AnnAssign):
        names = (node for node in ast.walk(statement) if isinstance(node, ast.Name))
        return {name.id for name in names if isinstance(name.ctx, ast.Store)}
    return set()


def code_sha256(source: str, entry: str = "compute") -> str:
    r"""Return the hash of a function and of the definitions of its module that it uses, directly or not.

    Args:
        source: The module.
        entry: The function's name.

    Example:
        >>> code = "N = 2\ndef compute(x):\n    'Multiply.'\n    return N * x\ndef render(y): return '3'"
        >>> code_sha256(code) == code_sha256("K = 2\ndef compute(a): return K * a")
        True
        >>> code_sha256(code) == code_sha256(code.replace("N = 2", "N = 3"))
        False
    """
    statements = ast.parse(source).body
    used, new = {entry}, {entry}
    while new:
        reached = [statement for statement in statements if _defined(statement) & new]
        names = {node.id for one in reached for node in ast.walk(one) if isinstance(node, ast.Name)}
        used, new = used | names, names - used
    kept = ast.Module([statement for statement in statements if _defined(statement) & used], [])
    for node in ast.walk(kept):
        if isinstance(node, ast.ClassDef | ast.FunctionDef) and ast.get_docstring(node) is not None:
            node.body = node.body[1:] or [ast.Pass()]
    return hashlib.sha256(ast.dump(_Normalise().visit(kept)).encode()).hexdigest()


def module_sha256(module: str) -> str:
    """Return the hash of `compute` in a module, which is not imported; empty if the module has no such function."""
    spec = find_spec(module)
    source = Path(spec.origin).read_text(encoding="utf-8") if spec and spec.origin else ""
    return code_sha256(source) if "def compute(" in source else ""
