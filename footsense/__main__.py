"""Entry point of `python -m footsense`: runs the command line."""

from footsense.cli import main

if __name__ == "__main__":
    main()
