"""Files of the wheel `footsense-client`: those of the checkout that the wheel `footsense` leaves out."""

import tomllib
from pathlib import Path
from typing import Any

from hatchling.builders.hooks.plugin.interface import BuildHookInterface


class FilesOfTheClient(BuildHookInterface[Any]):
    """Names the files; an editable installation has none, as it is a path to the checkout."""

    def initialize(self, version: str, build_data: dict[str, Any]) -> None:
        """Add the files to what is built, `version` being `standard` or `editable`."""
        if version == "standard":
            root = Path(self.root).parents[1]
            project = tomllib.loads((root / "pyproject.toml").read_text(encoding="utf-8"))
            paths = project["tool"]["hatch"]["build"]["targets"]["wheel"]["exclude"]
            files = {str(root / path[1:]): path[1:] for path in paths}
            build_data["force_include"] |= files | {str(root / "LICENSE"): "footsense/client/LICENSE"}
