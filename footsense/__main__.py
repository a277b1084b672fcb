"""Entry point of `python -m footsense`: runs the command line."""

import sys

if __name__ == "__main__":
    try:
        from footsense.cli import main
    except ModuleNotFoundError as error:
        sys.exit(
            f"footsense: the command line needs {error.name}; in the clone of footsense: activate its environment, or "
            "pip install deploy/client ."
        )
    main()
