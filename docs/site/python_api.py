"""The public names of a module, from its `__all__`, source and docstrings, as Markdown."""

import ast
import enum
import importlib
import inspect
import re
import textwrap
from collections.abc import Iterator
from typing import Any

from docstrings import table

#: Modules with a part of their own: what another one takes from them is told there.
_TOLD_APART = ("footsense.client", "firmware_interface.can.codes")
_WIDTH = 90
_SECTION = re.compile(
    r"^(Args|Attributes|Returns|Yields|Raises|Example|Source):(:?)\n((?:(?: {4}.*)?\n)+)", re.MULTILINE
)
_ENTRY = re.compile(r"^([*\w][\w, *]*): ", re.MULTILINE)
_COMMENT = re.compile(r"#: (.*)$", re.MULTILINE)


def markdown(module: str) -> str:
    """Return a section for each public name of a module, functions first: what it is called with, and its docstring."""
    found = importlib.import_module(module)
    classes = [name for name, value in vars(found).items() if getattr(value, "__module__", "") == module]
    public = [(name, getattr(found, name)) for name in getattr(found, "__all__", classes)]
    return "\n".join(
        _section(module, *each) for each in sorted(public, key=lambda each: inspect.isclass(each[1]))
    )


def _section(module: str, name: str, documented: Any) -> str:  # noqa: ANN401 - whatever a module has
    parts = [f"### `{name}`\n"]
    apart = [importlib.import_module(other) for other in _TOLD_APART if module != other]
    is_own = getattr(documented, "__module__", "") == module
    if not is_own and any(getattr(other, name, None) is documented for other in apart):
        return f"`{name}`: see [below](#{name.lower()}).\n"
    if inspect.isclass(documented) and issubclass(documented, enum.Enum):
        parts += [_prose(documented), table(["name", "value", "meaning"], list(_enum_rows(documented)))]
    elif callable(documented):
        parts += [_code(f"{name}{_signature(documented)}"), _prose(documented)]
        if inspect.isclass(documented):
            parts += [
                f"{_code(f'{name}.{inner}')}\n{_prose(member)}" for inner, member in _members(documented)
            ]
    else:
        parts.append(_code(f"{name} = {_value(documented)}"))
    return "\n".join(parts)


def _enum_rows(documented: type[enum.Enum]) -> Iterator[list[str]]:
    """Yield name, value and comment of each member, as the source has them, on whatever lines."""
    source = inspect.cleandoc("\n" + inspect.getsource(documented))
    (node,) = ast.parse(source).body
    assert isinstance(node, ast.ClassDef)
    lines = source.splitlines()
    for member in node.body:
        if isinstance(member, ast.Assign):
            comment = _COMMENT.search("\n".join(lines[member.lineno - 1 : member.end_lineno]))
            yield [
                f"`{ast.unparse(member.targets[0])}`",
                _source_of(member.value, source),
                comment[1] if comment else "",
            ]


def _source_of(node: ast.expr, source: str) -> str:
    text = ast.get_source_segment(source, node)
    assert text is not None
    return text


def _members(documented: type) -> Iterator[tuple[str, object]]:
    """Yield the public methods and properties that a class itself documents, with what each is called with."""
    for name, member in vars(documented).items():
        function = getattr(member, "__func__", member)
        if name.startswith("_") or not (inspect.isfunction(function) or isinstance(member, property)):
            continue
        if member.__doc__:
            yield name + ("" if isinstance(member, property) else _signature(function)), member


def _signature(documented: Any) -> str:  # noqa: ANN401 - a class or a function
    """Return parameters and result as the source has them; those of a class are its constructor's, or its fields."""
    (node,) = ast.parse(inspect.cleandoc("\n" + inspect.getsource(documented))).body
    if isinstance(node, ast.ClassDef):
        inits = [one for one in node.body if isinstance(one, ast.FunctionDef) and one.name == "__init__"]
        fields = [one for one in node.body if isinstance(one, ast.AnnAssign)]
        if inits:
            return _call(_parameters(inits[0].args), "")
        return _call([_field(one) for one in fields], "") if fields else ""
    assert isinstance(node, ast.FunctionDef)
    result = ast.unparse(node.returns) if node.returns else "None"
    return _call(_parameters(node.args), "" if result == "None" else f" -> {result}")


def _parameters(arguments: ast.arguments) -> list[str]:
    """Return each parameter with its type and default, without `self`."""
    found = []
    plain = [*arguments.posonlyargs, *arguments.args]
    defaults = [None] * (len(plain) - len(arguments.defaults)) + list(arguments.defaults)
    for one, default in zip(plain, defaults, strict=True):
        found.append(ast.unparse(one) + (f" = {ast.unparse(default)}" if default else ""))
    if arguments.vararg:
        found.append(f"*{ast.unparse(arguments.vararg)}")
    elif arguments.kwonlyargs:
        found.append("*")
    for one, default in zip(arguments.kwonlyargs, arguments.kw_defaults, strict=True):
        found.append(ast.unparse(one) + (f" = {ast.unparse(default)}" if default else ""))
    if arguments.kwarg:
        found.append(f"**{ast.unparse(arguments.kwarg)}")
    return [text for text in found if text not in {"self", "cls"}]


def _field(field: ast.AnnAssign) -> str:
    default = f" = {ast.unparse(field.value)}" if field.value else ""
    return f"{ast.unparse(field.target)}: {ast.unparse(field.annotation)}{default}"


def _call(parameters: list[str], result: str) -> str:
    line = f"({', '.join(parameters)}){result}"
    if len(line) <= _WIDTH:
        return line
    return "(\n" + "".join(f"    {one},\n" for one in parameters) + f"){result}"


def _value(constant: object) -> str:
    if isinstance(constant, tuple) and all(isinstance(one, int) for one in constant):
        return f"({', '.join(f'{one:#05x}' for one in constant)})"  # ids of CAN frames
    return repr(constant)


def _code(text: str) -> str:
    return f"```python\n{text}\n```\n"


def _prose(documented: object) -> str:
    """Return a docstring as Markdown: sections as lists, examples as code."""
    text = inspect.cleandoc(getattr(documented, "__doc__", None) or "") + "\n"
    text = _SECTION.sub(lambda part: _list(part[1], textwrap.dedent(part[3]).strip()) + "\n", text)
    return re.sub(r"\n{3,}", "\n\n", text).strip() + "\n"


def _list(title: str, body: str) -> str:
    if title == "Example":
        return f"```{'pycon' if body.startswith('>>>') else 'python'}\n{body}\n```\n"
    if title not in {"Args", "Attributes", "Raises"}:
        return f"{title}: {' '.join(body.split())}\n"
    entries = _ENTRY.split(body)[1:]
    lines = [
        f"- `{name}`: {' '.join(words.split())}"
        for name, words in zip(entries[::2], entries[1::2], strict=True)
    ]
    return f"{title}:\n\n" + "\n".join(lines) + "\n"
