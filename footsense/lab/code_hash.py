"""Hash of the code that computes a study's figures, insensitive to comments, prose and renamed identifiers.

The hash covers the function `compute` and all definitions of its module that it uses, directly or indirectly. Values of
constants with QUICK in their names are left out: no committed page is made with them.
Definitions that only the template uses are left out: its text is compared byte by byte. Changes in imported modules are
not detected.
"""

import ast
import hashlib
from importlib.util import find_spec
from pathlib import Path


class _NormaliseIdentifiers(ast.NodeTransformer):
    """AST transformer: replace identifiers by numbers, drop annotations and prose (strings with blanks)."""

    def __init__(self) -> None:
        self._numbers: dict[str, str] = {}

    def generic_visit(self, node: ast.AST) -> ast.AST:
        """Return the node with identifiers replaced by numbers."""
        for name, value in ast.iter_fields(node):
            if name in {"annotation", "returns"}:
                setattr(node, name, None)
            elif isinstance(value, str) and name in {"id", "attr", "arg", "name"}:
                setattr(node, name, self._numbers.setdefault(value, f"_{len(self._numbers)}"))
        if isinstance(node, ast.Constant) and isinstance(node.value, str) and " " in node.value:
            return ast.Constant("")
        return super().generic_visit(node)

    def visit_Assign(self, node: ast.Assign) -> ast.AST:
        """Return an assignment; the value is dropped if the constant's name contains QUICK."""
        target, value = node.targets[0], node.value
        if isinstance(target, ast.Name) and "QUICK" in target.id:
            node.value = ast.Constant("")
        elif isinstance(target, ast.Tuple) and isinstance(value, ast.Tuple):
            for place, name in enumerate(target.elts):
                if isinstance(name, ast.Name) and "QUICK" in name.id:
                    value.elts[place] = ast.Constant("")
        return self.generic_visit(node)


def _defined_names(statement: ast.stmt) -> set[str]:
    """Return the names that a module-level statement defines, imports excluded."""
    if isinstance(statement, ast.ClassDef | ast.FunctionDef):
        return {statement.name}
    if isinstance(statement, ast.Assign | ast.AnnAssign):
        names = (node for node in ast.walk(statement) if isinstance(node, ast.Name))
        return {name.id for name in names if isinstance(name.ctx, ast.Store)}
    return set()


def function_sha256(source: str, entry: str = "compute") -> str:
    r"""Return the SHA-256 of a function's normalised code and of all module-level definitions it uses.

    Args:
        source: Source text of the module.
        entry: Name of the function.

    Example:
        >>> code = "N = 2\ndef compute(x):\n    'Multiply.'\n    return N * x\ndef render(y): return '3'"
        >>> function_sha256(code) == function_sha256("K = 2\ndef compute(a): return K * a")
        True
        >>> function_sha256(code) == function_sha256(code.replace("N = 2", "N = 3"))
        False
        >>> code = "N, QUICK_N = 9, 2\ndef compute(quick): return QUICK_N if quick else N"
        >>> function_sha256(code) == function_sha256(code.replace("2", "3"))
        True
    """
    statements = ast.parse(source).body
    used, new = {entry}, {entry}
    while new:
        reached = [statement for statement in statements if _defined_names(statement) & new]
        names = {node.id for one in reached for node in ast.walk(one) if isinstance(node, ast.Name)}
        used, new = used | names, names - used
    kept = ast.Module([statement for statement in statements if _defined_names(statement) & used], [])
    for node in ast.walk(kept):
        if isinstance(node, ast.ClassDef | ast.FunctionDef) and ast.get_docstring(node) is not None:
            node.body = node.body[1:] or [ast.Pass()]
    return hashlib.sha256(ast.dump(_NormaliseIdentifiers().visit(kept)).encode()).hexdigest()


def compute_function_sha256(module: str) -> str:
    """Return the SHA-256 of a study module's `compute` without importing the module; empty if it has none."""
    spec = find_spec(module)
    source = Path(spec.origin).read_text(encoding="utf-8") if spec and spec.origin else ""
    return function_sha256(source) if "def compute(" in source else ""
